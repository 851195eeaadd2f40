"""Calibrates pitch and roll without a pattern, from the vertical and the two orthogonal level directions of a room."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.camera.mount import pitch_roll
from edgemap.geometry.camera.room_edges import (
    MINIMUM_SHARE,
    NEAR_RAD,
    level_axes,
    most_upright,
    room_axes,
    room_heading,
)
from edgemap.geometry.robust import FEWEST, ROUNDS
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.motion.attitude.segments import Segments

STEEPEST_RAD, REACH_RAD = math.radians(50.0), math.radians(12.0)  # search for up: first, then refined
FEWEST_EDGES = 20  # vertical, and level
WORST_TILT_RAD = math.radians(1.0)  # one standard deviation, and of single pictures in the median


@dataclass(frozen=True, slots=True)
class TiltFit:
    """The fitted tilt. sigma: standard deviations of pitch_rad and roll_rad, rad, from a jackknife over the
    pictures."""

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


def fit_tilt(pictures: list[Segments]) -> TiltFit:
    """Fits pitch and roll of a camera. Both must be constant over all pictures: a robot on a flat floor carries it.

    The edges of each picture are rotated about up to a common heading. `room_axes` is then applied to the edges of all
    pictures. Raises CalibrationError, with the numbers, if edges are too few, do not agree, or do not determine the
    tilt.
    """
    used = [edges for edges in pictures if len(edges)]
    if len(used) < FEWEST:
        raise CalibrationError(f"{len(used)} pictures with straight edges, need {FEWEST} or more")
    lengths = np.concatenate([edges.lengths for edges in used])
    normals = np.concatenate([edges.normals for edges in used])
    up = most_upright(normals, lengths, np.array([0.0, -1.0, 0.0]), STEEPEST_RAD)
    for _ in range(ROUNDS):  # only with edges that are almost vertical
        upright = (normals * lengths[:, None])[near := np.abs(normals @ up) < math.sin(NEAR_RAD)]
        axis = np.linalg.eigh(upright.T @ normals[near])[1][:, 0]
        up = axis * np.sign(axis @ up)
    up = _refined(used, up, ROUNDS)
    right, away = level_axes(up)
    misses = np.abs(np.arcsin(np.clip(_aligned(used, up) @ np.stack([up, right, away]).T, -1.0, 1.0)))
    kind, miss = misses.argmin(axis=1), misses.min(axis=1)
    near = miss < NEAR_RAD
    vertical, level = int((near & (kind == 0)).sum()), int((near & (kind > 0)).sum())
    share = float(lengths[near].sum() / lengths.sum())
    if vertical < FEWEST_EDGES or level < FEWEST_EDGES or share < MINIMUM_SHARE:
        raise CalibrationError(
            f"{vertical} vertical and {level} level edges in {len(used)} pictures, {100 * share:.0f} % of all, "
            f"need {FEWEST_EDGES} of either and {100 * MINIMUM_SHARE:.0f} %: show walls, doors, shelves"
        )
    rooms = [room_axes(edges.normals, edges.lengths, up, REACH_RAD) for edges in used]
    nodding_rad = float(np.median([math.acos(min(1.0, float(room.up @ up))) for room in rooms if room] or [0.0]))
    if nodding_rad > WORST_TILT_RAD:
        raise CalibrationError(
            f"the camera's tilt changes by {math.degrees(nodding_rad):.1f} deg (median) from picture to picture, at "
            f"most {math.degrees(WORST_TILT_RAD):g} allowed: pictures must come from the robot on a flat floor"
        )
    # Each picture left out in turn: the edges of one have correlated errors.
    angles = [pitch_roll(_refined(used[:at] + used[at + 1 :], up, 1)) for at in range(len(used))]
    pitch_sigma, roll_sigma = np.sqrt((len(used) - 1) * np.var(np.array(angles), axis=0)).tolist()
    if not max(pitch_sigma, roll_sigma) <= WORST_TILT_RAD:
        raise CalibrationError(
            f"pitch known to {math.degrees(pitch_sigma):.1f} deg and roll to {math.degrees(roll_sigma):.1f} deg only, "
            f"expected {math.degrees(WORST_TILT_RAD):g}: more pictures, turned to other walls"
        )
    rms_deg = math.degrees(math.sqrt(float(np.average(miss[near] ** 2, weights=lengths[near]))))
    return TiltFit(*pitch_roll(up), (pitch_sigma, roll_sigma), rms_deg, vertical, level, share, len(used))


def _refined(pictures: list[Segments], up: Array, rounds: int) -> Array:
    """Refines up, (3,). Returns the first guess if the edges of all pictures show no room."""
    lengths = np.concatenate([edges.lengths for edges in pictures])
    for _ in range(rounds):
        room = room_axes(_aligned(pictures, up), lengths, up, REACH_RAD)
        up = up if room is None else room.up
    return up


def _aligned(pictures: list[Segments], up: Array) -> Array:
    """Normals of all edges, (N, 3), rotated about up so that the room is aligned with `level_axes`.

    The rotation is at most 45 degrees, so it does not change the error of up.
    """
    turned = []
    for edges in pictures:
        heading = (room_heading(edges.normals, edges.lengths, up) + math.pi / 4.0) % (math.pi / 2.0) - math.pi / 4.0
        turned.append(edges.normals @ small_rotation(*(heading * up)))
    return np.concatenate(turned)
