"""Pitch and roll without a pattern: rooms are built of verticals and of two level directions at right angles."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.room_edges import NEAR_RAD, level_axes, room_heading
from edgemap.runtime.calibration.level import pitch_roll, up_optical
from edgemap.runtime.calibration.segments import Segments
from edgemap.runtime.errors import CalibrationError

STEEPEST_RAD = math.radians(50.0)  # between the picture's columns and up, for the search
TRIALS = 2000
ROUNDS = 4
FEWEST_VERTICAL, FEWEST_LEVEL, FEWEST_PICTURES = 20, 20, 3
MINIMUM_SHARE = 0.35  # of all edges' length that the three directions explain
ENOUGH_UPRIGHT = 6  # upright edges of a picture that gives a vertical of its own
MAXIMUM_NODDING_RAD = math.radians(1.0)
WORST_TILT_RAD = math.radians(1.0)  # one standard deviation


@dataclass(frozen=True, slots=True)
class TiltFit:
    """What came out. sigma: one standard deviation of pitch_rad and roll_rad, by leaving out pictures (jackknife)."""

    pitch_rad: float
    roll_rad: float
    sigma: tuple[float, float]
    rms_deg: float
    vertical: int
    level: int
    share: float
    pictures: int

    def record(self) -> dict[str, Any]:
        """For camera.yaml's `calibration`."""
        return {
            "method": "vanishing points",
            "pictures": self.pictures,
            "vertical_edges": self.vertical,
            "level_edges": self.level,
            "explained_share": round(self.share, 3),
            "rms_deg": round(self.rms_deg, 4),
            "sigma_pitch_deg": round(math.degrees(self.sigma[0]), 4),
            "sigma_roll_deg": round(math.degrees(self.sigma[1]), 4),
        }


def fit_tilt(pictures: list[Segments], seed: int = 0) -> TiltFit:
    """Pitch and roll of a camera that keeps them over all pictures (it is mounted on a robot on a flat floor).

    The vertical by RANSAC over the upright edges of all pictures together; each picture's heading to the walls from its
    other edges; then all by least squares on the angles between edges' planes and directions. Raises CalibrationError
    with the numbers where edges are too few, do not agree, or leave the tilt open.
    """
    used = [segments for segments in pictures if len(segments)]
    if len(used) < FEWEST_PICTURES:
        raise CalibrationError(f"{len(used)} pictures with straight edges, need {FEWEST_PICTURES} or more")
    up = _vertical(used, np.random.default_rng(seed))
    fit = _UprightFit(used, up)
    vertical, level = fit.counts()
    if vertical < FEWEST_VERTICAL or level < FEWEST_LEVEL or fit.share() < MINIMUM_SHARE:
        raise CalibrationError(
            f"{vertical} vertical and {level} level edges in {len(used)} pictures, {100 * fit.share():.0f} % of all, "
            f"need {FEWEST_VERTICAL}, {FEWEST_LEVEL} and {100 * MINIMUM_SHARE:.0f} %: show walls, doors, shelves"
        )
    pitch_rad, roll_rad = pitch_roll(fit.up)
    nodding_rad = _nodding(used, fit.up)
    if nodding_rad > MAXIMUM_NODDING_RAD:
        raise CalibrationError(
            f"the camera's tilt changes by {math.degrees(nodding_rad):.1f} deg (median) from picture to picture, at "
            f"most {math.degrees(MAXIMUM_NODDING_RAD):g} allowed: pictures must come from the robot on a flat floor"
        )
    sigma = _jackknife(used, fit.up)
    if not max(sigma) <= WORST_TILT_RAD:
        raise CalibrationError(
            f"pitch known to {math.degrees(sigma[0]):.1f} deg and roll to {math.degrees(sigma[1]):.1f} deg only, "
            f"expected {math.degrees(WORST_TILT_RAD):g}: more pictures, turned to other walls"
        )
    return TiltFit(pitch_rad, roll_rad, sigma, fit.rms_deg(), vertical, level, fit.share(), len(used))


class _UprightFit:
    """Up for all pictures and a heading for each, refined from a first guess of up."""

    def __init__(self, pictures: list[Segments], up: Array, rounds: int = ROUNDS) -> None:
        self.pictures = pictures
        self.normals = np.concatenate([segments.normals for segments in pictures])
        self.lengths = np.concatenate([segments.lengths for segments in pictures])
        self.which = np.repeat(np.arange(len(pictures)), [len(segments) for segments in pictures])
        self.up = up
        for _ in range(rounds):
            headings = np.array([room_heading(each.normals, each.lengths, self.up) for each in pictures])
            self._assign(headings)
            self._refine(headings)

    def counts(self) -> tuple[int, int]:
        """Edges that are vertical, and level along a wall."""
        return int((self.kind == 0).sum()), int((self.kind > 0).sum())

    def share(self) -> float:
        """Of all edges' length, what the three directions explain."""
        return float(self.lengths[self.kind >= 0].sum() / self.lengths.sum())

    def rms_deg(self) -> float:
        """Angle between edges' planes and their directions, weighted by length."""
        errors = self._errors(self.up, self.headings)[self.kind >= 0]
        weights = self.lengths[self.kind >= 0]
        return math.degrees(math.sqrt(float((weights * errors**2).sum() / weights.sum())))

    def _assign(self, headings: Array) -> None:
        """kind: 0 vertical, 1 and 2 the level directions, -1 none of them."""
        angles = np.abs(np.stack([np.arcsin(np.clip(self._dots(self.up, headings, k), -1, 1)) for k in range(3)]))
        self.kind = np.where(angles.min(axis=0) < NEAR_RAD, angles.argmin(axis=0), -1)

    def _dots(self, up: Array, headings: Array, kind: int) -> Array:
        if kind == 0:
            return self.normals @ up
        right, away = level_axes(up)
        turn = headings[self.which] + (kind - 1) * math.pi / 2.0
        directions = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * away
        return (self.normals * directions).sum(axis=1)

    def _errors(self, up: Array, headings: Array) -> Array:
        dots = np.stack([self._dots(up, headings, k) for k in range(3)])
        return np.arcsin(np.clip(np.take_along_axis(dots, np.maximum(self.kind, 0)[None], axis=0)[0], -1, 1))

    def _refine(self, headings: Array) -> None:
        weights = np.sqrt(self.lengths) * (self.kind >= 0)

        def residuals(values: Array) -> Array:
            return weights * self._errors(up_optical(*values[:2]), values[2:]) / NEAR_RAD

        start = np.array([*pitch_roll(self.up), *headings])
        rows = np.arange(len(weights))
        depends = lil_matrix((len(weights), len(start)), dtype=int)
        depends[:, :2] = 1
        depends[rows, 2 + self.which] = 1  # an edge knows its own picture's heading only
        fit = least_squares(residuals, start, loss="soft_l1", f_scale=0.2, jac_sparsity=depends, xtol=1e-7, ftol=1e-7)
        self.up, self.headings = up_optical(*fit.x[:2]), fit.x[2:]


def _vertical(pictures: list[Segments], random: np.random.Generator, fewest: int = FEWEST_VERTICAL) -> Array:
    """The direction that most upright edges of all pictures share, by length, (3,)."""
    normals = np.concatenate([segments.normals for segments in pictures])
    lengths = np.concatenate([segments.lengths for segments in pictures])
    upright = np.concatenate([segments.upright for segments in pictures]) > math.cos(STEEPEST_RAD)
    normals, lengths = normals[upright], lengths[upright]
    if len(normals) < fewest:
        raise CalibrationError(
            f"{len(normals)} upright edges in all pictures, need {FEWEST_VERTICAL}: show walls, doors"
        )
    pairs = random.choice(len(normals), size=(TRIALS, 2), p=lengths / lengths.sum())
    guesses = np.cross(normals[pairs[:, 0]], normals[pairs[:, 1]])
    size = np.linalg.norm(guesses, axis=1)
    guesses = guesses[size > math.sin(math.radians(3.0))]  # edges nearly in one plane say little of where they meet
    guesses = guesses / np.linalg.norm(guesses, axis=1, keepdims=True)
    guesses *= -np.sign(guesses[:, 1:2])  # up is where the picture's rows come from
    guesses = guesses[-guesses[:, 1] > math.cos(STEEPEST_RAD)]
    if len(guesses) == 0:
        raise CalibrationError("upright edges have no direction in common: show walls, doors, shelves")
    near = np.abs(guesses @ normals.T) < math.sin(NEAR_RAD)
    return guesses[(near * lengths).sum(axis=1).argmax()]


def _nodding(pictures: list[Segments], up: Array) -> float:
    """Median angle between the common vertical and the one that each picture gives by itself, rad."""
    found = []
    for segments in pictures:
        try:
            own = _vertical([segments], np.random.default_rng(0), ENOUGH_UPRIGHT)
        except CalibrationError:  # too little upright in this one
            continue
        found.append(math.acos(min(1.0, float(_UprightFit([segments], own, rounds=2).up @ up))))
    return float(np.median(found)) if found else 0.0


def _jackknife(pictures: list[Segments], up: Array) -> tuple[float, float]:
    """Standard deviations of pitch and roll from leaving out tenths of the pictures: edges of one err together."""
    groups = min(len(pictures), 10)
    found = []
    for group in range(groups):
        rest = [segments for index, segments in enumerate(pictures) if index % groups != group]
        found.append(pitch_roll(_UprightFit(rest, up, rounds=1).up))
    sigma = np.sqrt((groups - 1) * np.var(np.array(found), axis=0))
    return float(sigma[0]), float(sigma[1])
