"""A first guess of intrinsics and mount of an uncalibrated camera, from its pictures and the objects in them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.level import pitch_roll
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.room_edges import level_axes, room_axes
from edgemap.geometry.observations.class_extents import HEIGHT_M, MEASURED
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import BORDER_PX, lens_heights
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.motion.attitude.segments import line_ends, segments_between

# Of the picture's longer side: webcams, phones that film and the colour cameras of depth cameras have 0.65 to 1.
USUAL_FOCAL, FOCAL_SIGMA = 0.8, 0.22
FOCALS = np.exp(np.linspace(math.log(0.35), math.log(1.5), 24))  # shares that are tried
# Barrel distortion, as the share by which it draws in the middle of the picture's left and right side.
BENDS = (0.0, -0.04, -0.08, -0.12)
# Of the logarithm of the focal length at which one picture's edges agree best: of good ones, the share of these, and of
# the mean (2 % RMS on tuning homes 9000-9004 and 9100). SHOWN_SHARE: of the focal lengths at which a picture must show
# the room.
PEAK_SIGMA, PEAK_SHARE, EDGES_SIGMA, SHOWN_SHARE = 0.05, 0.6, 0.02, 0.5
EDGE_SIGMA_RAD, EDGE_LIMIT, STEEPEST_RAD = math.radians(0.7), 6.0, math.radians(40.0)
SURE_RAD = math.radians(0.5)  # of a pitch by edges with the right focal length
FEWEST_ROOMS = 4  # pictures whose edges show the room
# Scatter of the roll from picture to picture (1.48 times the median deviation) of a camera that is no robot's: 2.5 to
# 3.6 degrees on the lounge, hololens and redkitchen walks, 0.2 to 0.7 on tuning homes 9000-9005.
SWAYING_RAD = math.radians(1.5)
USUAL_PITCH_RAD, PITCH_SIGMA_RAD = math.radians(8.0), math.radians(10.0)  # of robots' cameras, where no edges tell
USUAL_HEIGHT_M, HEIGHT_SIGMA = 0.6, 0.7  # of the lens, and of its logarithm
CARRIED_HEIGHT_M, CARRIED_SIGMA = 1.5, 0.15  # of a camera in a person's hands, before the chest, or on the head
TRIED_PITCH_RAD = np.radians(np.arange(-10.0, 46.0, 1.0))
FARTHEST_HEIGHTS = 15.0  # farther than so many lens heights, pitch decides alone
LOWEST_M, HIGHEST_M = 0.05, 3.0
LEAST_FLOOR = 0.1  # share of the picture below the horizon

Picture = NDArray[np.uint8]
Detector = Callable[[Picture], Detections]


@dataclass(frozen=True, slots=True)
class CameraGuess:
    """lens, mount: the guess. focal_sigma, height_sigma: one standard deviation as a share; pitch_sigma_rad. how: what
    each came from, in words. sway_rad: standard deviation of the pitch of a camera that is carried, else 0."""

    lens: Intrinsics
    mount: Mount
    focal_sigma: float
    height_sigma: float
    pitch_sigma_rad: float
    how: tuple[str, ...]
    sway_rad: float = 0.0

    def lines(self) -> list[str]:
        """The guess with its uncertainty, for display."""
        lens, mount = self.lens, self.mount
        focal, height, pitch = self.how
        pitch_deg, roll_deg = math.degrees(mount.pitch_rad), math.degrees(mount.roll_rad)
        sway = f"the camera sways by {math.degrees(self.sway_rad):.0f} deg from picture to picture: it is carried"
        return [
            f"focal length {lens.fx:.0f} +- {100 * self.focal_sigma:.0f} % px ({focal})",
            f"lens {mount.height_m:.2f} m +- {100 * self.height_sigma:.0f} % above the floor ({height})",
            f"pitch {pitch_deg:.1f} +- {math.degrees(self.pitch_sigma_rad):.1f} deg, roll {roll_deg:.1f} deg ({pitch})",
            *([f"{sway}; pitch and height are not constant"] if self.sway_rad else []),
        ]

    def record(self) -> dict[str, object]:
        """For run.json, and for camera.yaml's `calibration`."""
        record: dict[str, object] = {
            "method": "guessed",
            "focal_sigma_share": round(self.focal_sigma, 3),
            "height_sigma_share": round(self.height_sigma, 3),
            "sigma_pitch_deg": round(math.degrees(self.pitch_sigma_rad), 2),
            "from": list(self.how),
        }
        return record | ({"sway_deg": round(math.degrees(self.sway_rad), 1)} if self.sway_rad else {})


@dataclass(frozen=True, slots=True)
class Focal:
    """A focal length that a file states: px, its standard deviation as a share, and its source."""

    px: float
    sigma: float
    source: str


def guess_camera(
    pictures: Sequence[Picture],
    detect: Detector,
    lens: Intrinsics | None = None,
    mount: Mount | None = None,
    stated: Focal | None = None,
) -> CameraGuess:
    """Lens and mount of the camera that took these pictures.

    Focal length: as stated by the files, else from the usual field of view and the room's edges (three directions
    become orthogonal at the correct one). Pitch and roll: from the room's edges, else the angles at which objects of
    usual heights agree. Height: objects of usual heights. lens, mount: given ones, which are kept. Raises
    CalibrationError, with the numbers, for pictures that show no floor and a lens outside 0.05 to 3 m above it.
    """
    if not pictures:
        raise CalibrationError("no picture came to guess the camera from")
    height, width = pictures[0].shape[:2]
    ends = [line_ends(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) for picture in pictures]
    focal_sigma, focal_how = 0.0, "as given"
    if lens is None:
        share, focal_sigma, bend, focal_how = _by_edges(ends, width, height)
        if stated is not None:
            share, focal_sigma, bend, focal_how = stated.px / max(width, height), stated.sigma, 0.0, stated.source
        lens = _lens(width, height, share, bend)
    boxes = [detect(picture) for picture in pictures]
    if mount is not None:
        return CameraGuess(lens, mount, focal_sigma, 0.0, 0.0, (focal_how, "as given", "as given"))
    ups, usual = _ups(ends, lens), (USUAL_HEIGHT_M, HEIGHT_SIGMA)
    roll, sway_rad, scatter, by_edges = 0.0, 0.0, 0.0, None
    if len(ups) >= FEWEST_ROOMS:
        angles = np.array([pitch_roll(up) for up in ups])
        by_edges, roll = np.median(angles, axis=0).tolist()
        scatter, roll_scatter = (1.48 * np.median(np.abs(angles - [by_edges, roll]), axis=0)).tolist()
        if roll_scatter > SWAYING_RAD:
            sway_rad, usual = scatter, (CARRIED_HEIGHT_M, CARRIED_SIGMA)
    pitch, pitch_sigma, count = _pitch_by_sizes(boxes, lens, usual if sway_rad else None)
    pitch_how = f"{count} objects of usual sizes" if count else "usual for a robot"
    if by_edges is not None:
        # A focal length that is wrong turns the horizon's row into another pitch.
        edges_sigma = math.hypot(abs(by_edges) * focal_sigma, SURE_RAD, scatter)
        weights = np.array([pitch_sigma, edges_sigma]) ** -2
        pitch = float(weights @ [pitch, by_edges] / weights.sum())
        pitch_sigma, pitch_how = float(weights.sum() ** -0.5), f"the edges of {len(ups)} pictures, {pitch_how}"
    pitch_sigma = math.hypot(pitch_sigma, sway_rad)
    tilted = Mount(1.0, pitch, roll)
    floor_share = _floor_share(lens, tilted)
    if floor_share < LEAST_FLOOR:
        raise CalibrationError(
            f"{100 * floor_share:.0f} % of the picture lies below the horizon (pitch {math.degrees(pitch):.1f} deg up "
            f"to {math.degrees(pitch_sigma):.1f}): no floor is seen; tilt the camera down, or pass --mount"
        )
    height_m, height_sigma, count = _height(boxes, lens, tilted, pitch_sigma, usual)
    if not LOWEST_M <= height_m <= HIGHEST_M:
        raise CalibrationError(
            f"{count} objects of usual sizes put the lens {height_m:.2f} m above the floor, expected {LOWEST_M:g} to "
            f"{HIGHEST_M:g} m: pass --mount HEIGHT_M,PITCH_DEG"
        )
    how = f"{count} objects of usual sizes" if count else "usual for a robot; no object of a known size was seen"
    how = (focal_how, how, pitch_how)
    return CameraGuess(lens, Mount(height_m, pitch, roll), focal_sigma, height_sigma, pitch_sigma, how, sway_rad)


def _lens(width: int, height: int, share: float, bend: float = 0.0) -> Intrinsics:
    """A lens of square pixels and a centred axis. share: focal length of the longer side. bend: see BENDS."""
    distortion = Distortion("brown_conrady", (bend * 4.0 * share**2,)) if bend else Distortion()
    focal_px = share * max(width, height)
    return Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0, distortion)


def _by_edges(ends: list[Array], width: int, height: int) -> tuple[float, float, float, str]:
    """Focal length as a share of the longer side, its sigma, the bend, and how: by the usual field of view, and by the
    room's edges where enough pictures show them, whose three directions are at right angles under the right lens."""
    usual = USUAL_FOCAL, FOCAL_SIGMA, 0.0, "usual field of view"
    agreed = []
    for bend in BENDS:
        peaks = _peaks(ends[::2], width, height, bend)
        agreed.append(float(np.mean(peaks[:, 1])) if len(peaks) else 0.0)
    bend = _vertex(np.array(BENDS), np.array(agreed), int(np.argmax(agreed)))[0]
    peaks = _peaks(ends, width, height, bend)
    if len(peaks) < FEWEST_ROOMS:
        return usual
    # A picture's best focal length is near the right one, or anywhere.
    logs = np.linspace(math.log(FOCALS[0]), math.log(FOCALS[-1]), 500)
    near = np.exp(-0.5 * ((peaks[:, :1] - logs) / PEAK_SIGMA) ** 2) / (PEAK_SIGMA * math.sqrt(2.0 * math.pi))
    cost = 0.5 * ((logs - math.log(USUAL_FOCAL)) / FOCAL_SIGMA) ** 2
    cost -= np.log(PEAK_SHARE * near + (1.0 - PEAK_SHARE) / np.ptp(logs)).sum(axis=0)
    weights = np.exp(cost.min() - cost)
    weights /= weights.sum()
    mean = float(weights @ logs)
    sigma = math.hypot(EDGES_SIGMA, math.sqrt(float(weights @ (logs - mean) ** 2)))
    return math.exp(mean), sigma, bend, f"usual field of view, edges of {len(peaks)} pictures"


def _peaks(ends: list[Array], width: int, height: int, bend: float) -> Array:
    """Of each picture whose edges show the room: logarithm of the focal length (share) at which they agree best; how
    well they do; (N, 2)."""
    lenses, found = [_lens(width, height, share, bend) for share in FOCALS], []
    for lines in ends:
        fits = np.array([_explained(lines, lens) for lens in lenses])
        if np.isfinite(fits).mean() >= SHOWN_SHARE:
            found.append(_vertex(np.log(FOCALS), fits, int(np.nanargmax(fits))))
    return np.array(found).reshape(-1, 2)


def _vertex(places: Array, values: Array, best: int) -> tuple[float, float]:
    """Place and value of the maximum of evenly spaced values, by a parabola through the best and its neighbours."""
    around = values[max(best - 1, 0) : best + 2]
    if len(around) < 3 or not np.isfinite(around).all():
        return float(places[best]), float(values[best])
    left, middle, right = around.tolist()
    off = 0.5 * (left - right) / min(left - 2.0 * middle + right, -1e-9)
    return float(places[best] + off * (places[1] - places[0])), middle - 0.25 * (left - right) * off


def _explained(lines: Array, lens: Intrinsics) -> float:
    """How well three directions at right angles explain a picture's edges, per edge; NaN where they show no room.

    Per edge, as a short focal length, under which all edges are longer, would otherwise always explain more.
    """
    edges = segments_between(lines, lens)
    room = room_axes(edges.normals, edges.lengths, np.array([0.0, -1.0, 0.0]), STEEPEST_RAD) if len(edges) else None
    if room is None or room.level_rad is None:
        return math.nan
    right, away = level_axes(room.up)
    first = math.cos(room.level_rad) * away - math.sin(room.level_rad) * right
    directions = np.stack([room.up, first, np.cross(room.up, first)])
    miss = np.arcsin(np.clip(np.abs(edges.normals @ directions.T).min(axis=1), 0.0, 1.0))
    worth = EDGE_LIMIT - np.minimum((miss / EDGE_SIGMA_RAD) ** 2, EDGE_LIMIT)
    weight = np.minimum(edges.lengths * lens.fx / (0.15 * lens.width), 2.0)
    return float(weight @ worth / weight.sum())


def _ups(ends: list[Array], lens: Intrinsics) -> list[Array]:
    """Up in each picture whose edges show the room, (3,) of the optical frame."""
    level, found = np.array([0.0, -1.0, 0.0]), []
    for lines in ends:
        edges = segments_between(lines, lens)
        room = room_axes(edges.normals, edges.lengths, level, STEEPEST_RAD) if len(edges) else None
        if room is not None:
            found.append(room.up)
    return found


def _pitch_by_sizes(
    boxes: list[Detections], lens: Intrinsics, usual: tuple[float, float] | None
) -> tuple[float, float, int]:
    """The pitch at which objects of usual heights agree on the lens's height: pitch, its sigma, and how many there are.
    usual: height of the lens and the sigma of its logarithm, where it is known that well.

    Maximum posterior on a grid, with the usual pitch as prior; near and far objects disagree at a wrong one.
    """
    costs, counts = [], []
    for pitch in TRIED_PITCH_RAD.tolist():
        logs, sigmas = _logs(boxes, lens, Mount(1.0, pitch))
        cost = 0.5 * ((pitch - USUAL_PITCH_RAD) / PITCH_SIGMA_RAD) ** 2
        if usual is not None:
            cost += float(np.log1p(((logs - math.log(usual[0])) / np.hypot(sigmas, usual[1])) ** 2).sum())
        elif len(logs) > 1:
            cost += float(np.log1p(((logs - np.median(logs)) / sigmas) ** 2).sum())
        costs.append(cost)
        counts.append(len(logs))
    # A pitch at which boxes drop out must not gain by it: each one that is missing costs as much as a bad one.
    total = np.array(costs) + 2.0 * (max(counts) - np.array(counts))
    weights = np.exp(-(total - total.min()))
    weights /= weights.sum()
    mean = float(weights @ TRIED_PITCH_RAD)
    sigma = math.sqrt(float(weights @ (TRIED_PITCH_RAD - mean) ** 2) + math.radians(1.0) ** 2)
    return mean, sigma, max(counts)


def _height(
    boxes: list[Detections], lens: Intrinsics, tilted: Mount, pitch_sigma: float, usual: tuple[float, float]
) -> tuple[float, float, int]:
    """Lens above the floor, m; its sigma as a share; and how many objects show it. usual: without them."""
    information = usual[1] ** -2
    if (shown := _height_by_sizes(boxes, lens, tilted)) is None:
        return *usual, 0
    mean, variance, count = shown
    pitches = tilted.pitch_rad - pitch_sigma, tilted.pitch_rad + pitch_sigma
    turned = [_height_by_sizes(boxes, lens, replace(tilted, pitch_rad=pitch)) for pitch in pitches]
    logs = [mean if one is None else one[0] for one in turned]
    variance += (0.5 * (logs[1] - logs[0])) ** 2
    total = information + 1.0 / variance
    return math.exp((math.log(usual[0]) * information + mean / variance) / total), total**-0.5, count


def _height_by_sizes(boxes: list[Detections], lens: Intrinsics, tilted: Mount) -> tuple[float, float, int] | None:
    """Logarithm of the lens's height, its variance, and how many objects show it; None where none does. Each class
    counts as one observation with the scatter of its kind, as objects of a class are alike within a home."""
    camera, by_kind = FloorCamera(lens, tilted), dict[tuple[str, float], list[float]]()
    for found in boxes:
        for one in lens_heights(found, camera):
            by_kind.setdefault((one.label, HEIGHT_M[one.label][1]), []).append(math.log(one.height_m))
        for label, height_m in _by_widths(found, camera):
            shape = MEASURED[label]
            by_kind.setdefault((label, shape.width_sigma / shape.width), []).append(math.log(height_m))
    means, information = list[float](), list[float]()
    for (_, kind_sigma), logs in by_kind.items():
        spread = 1.48 * float(np.median(np.abs(np.array(logs) - np.median(logs)))) + 0.1
        means.append(float(np.median(logs)))
        information.append(1.0 / (kind_sigma**2 + spread**2 / len(logs) + 0.05**2))
    if not means:
        return None
    weights = np.array(information)
    return float(weights @ means / weights.sum()), 1.0 / float(weights.sum()), sum(map(len, by_kind.values()))


def _by_widths(found: Detections, camera: FloorCamera) -> list[tuple[str, float]]:
    """Label and the lens's height by each box of a class of usual width that stands on the floor uncut at its foot and
    sides: what is high, near and cut above shows a low lens. camera: 1 m above the floor."""
    shapes, seen = [MEASURED.get(label) for label in found.labels], []
    for row, shape in enumerate(shapes):
        left, _, right, foot = found.boxes[row].tolist()
        inside = (
            left > BORDER_PX
            and right < camera.intrinsics.width - BORDER_PX
            and foot < camera.intrinsics.height - BORDER_PX
        )
        if shape is None or not inside:
            continue
        ends = camera.floor_points([(left, foot - 0.5), (right, foot - 0.5)])
        wide_m = float(np.linalg.norm(ends[1] - ends[0]))
        if np.isfinite(ends).all() and np.linalg.norm(ends.mean(axis=0)) < FARTHEST_HEIGHTS:
            seen.append((found.labels[row], shape.width / max(wide_m, 1e-3)))
    return seen


def _logs(boxes: list[Detections], lens: Intrinsics, tilted: Mount) -> tuple[Array, Array]:
    """Logarithm of the lens's height by each object, and its sigma."""
    camera = FloorCamera(lens, tilted)
    found = [one for detections in boxes for one in lens_heights(detections, camera)]
    return (
        np.array([math.log(one.height_m) for one in found]),
        np.array([math.hypot(HEIGHT_M[one.label][1], 0.1) for one in found]),
    )


def _floor_share(lens: Intrinsics, mount: Mount) -> float:
    """Share of the picture's height below the horizon, in the middle column."""
    row = FloorCamera(lens, mount).horizon_row()
    return float(np.clip((lens.height - row) / lens.height, 0.0, 1.0))
