"""A first guess of intrinsics and mount of an uncalibrated camera, from its pictures and the objects in them."""

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.calibrate.floor_depth import MAXIMUM_SCATTER_RAD
from edgemap.calibrate.guess_focal import (
    focal_by_edges,
    plain_lens,
    ups_by_edges,
)
from edgemap.calibrate.guess_sizes import (
    CARRIED_HEIGHT_M,
    CARRIED_SIGMA,
    HEIGHT_SIGMA,
    USUAL_HEIGHT_M,
    height_by_sizes,
    pitch_by_sizes,
)
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, pitch_roll
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.robust import FEWEST, median_and_scatter
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M
from edgemap.runtime.motion.attitude.segments import line_ends
from edgemap.runtime.motion.camera_guess import CameraGuess

# Of a pitch by edges with the right focal length: 0.34 degrees RMS on twelve rendered homes, where the pitch by sizes
# errs by 3 degrees.
SURE_RAD = math.radians(0.35)
STATED_SIGMA = 0.05  # of a focal length that a file states, as a share
LEAST_FLOOR = 0.1  # share of the picture below the horizon

Picture = NDArray[np.uint8]
Detector = Callable[[Picture], Detections]
TRIED = 10  # pictures
CLEAR = 2.0  # times the scores: 3 to 8 on three real walks and a rendered home that were turned by 90 degrees


def guess_camera(
    pictures: Sequence[Picture],
    detect: Detector,
    lens: Intrinsics | None = None,
    mount: Mount | None = None,
    stated: tuple[float, str] | None = None,
    height_m: float | None = None,
) -> CameraGuess:
    """Lens and mount of the camera that took these pictures.

    Focal length: as stated by the files, else from the usual field of view and the room's edges (three directions
    become orthogonal at the correct one). Pitch and roll: from the room's edges, else the angles at which objects of
    usual heights agree. Height: objects of usual heights. lens, mount, height_m: configured values, which stay. stated:
    a focal length in px, and what states it. Raises CalibrationError, with the numbers, for pictures without floor, or
    a lens outside 0.05 to 3 m above it.
    """
    if not pictures:
        raise CalibrationError("no picture came to guess the camera from")
    height, width = pictures[0].shape[:2]
    ends = [line_ends(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) for picture in pictures]
    focal_sigma, focal_how = 0.0, "as given"
    if lens is None:
        share, focal_sigma, bend, focal_how = focal_by_edges(ends, width, height)
        if stated is not None:
            share, focal_sigma, bend, focal_how = stated[0] / max(width, height), STATED_SIGMA, 0.0, stated[1]
        lens = plain_lens(width, height, share, bend)
    boxes = [detect(picture) for picture in pictures]
    if mount is not None:
        return CameraGuess(lens, mount, focal_sigma, 0.0, 0.0, (focal_how, "as given", "as given"))
    edges = _tilt_by_edges(ends, lens, focal_sigma)
    pitch, roll, pitch_sigma, sway_rad, pitch_how = edges or (0.0, 0.0, math.inf, 0.0, "")
    if edges is None or sway_rad:
        carried = (CARRIED_HEIGHT_M, CARRIED_SIGMA) if sway_rad else None
        by_sizes, sizes_sigma, count = pitch_by_sizes(boxes, lens, carried)
        sizes_how = f"{count} objects of usual sizes" if count else "usual for a robot"
        if sway_rad:  # a person who walks looks up and down: edges show the level pictures
            weights = np.array([sizes_sigma, math.hypot(pitch_sigma, sway_rad)]) ** -2
            pitch = float(weights @ [by_sizes, pitch] / weights.sum())
            pitch_sigma, pitch_how = math.hypot(weights.sum() ** -0.5, sway_rad), f"{pitch_how}, {sizes_how}"
        else:
            pitch, pitch_sigma, pitch_how = by_sizes, sizes_sigma, sizes_how
    tilted = Mount(1.0, pitch, roll)
    horizon_row = FloorCamera(lens, tilted).horizon_row()  # in the middle column
    floor_share = float(np.clip((lens.height - horizon_row) / lens.height, 0.0, 1.0))
    if floor_share < LEAST_FLOOR:
        raise CalibrationError(
            f"{100 * floor_share:.0f} % of the picture lies below the horizon (pitch {math.degrees(pitch):.1f} deg up "
            f"to {math.degrees(pitch_sigma):.1f}): no floor is seen; tilt the camera down, or pass --mount"
        )
    height_sigma, height_how = 0.0, "as given"
    if height_m is None and sway_rad:  # the tilt of single pictures is too uncertain for sizes
        height_m, height_sigma, height_how = CARRIED_HEIGHT_M, CARRIED_SIGMA, "as a person carries it"
    elif height_m is None:
        usual = USUAL_HEIGHT_M, HEIGHT_SIGMA
        height_m, height_sigma, count = height_by_sizes(boxes, lens, tilted, pitch_sigma, usual)
        if not LOWEST_M <= height_m <= HIGHEST_M:
            raise CalibrationError(
                f"{count} objects of usual sizes put the lens {height_m:.2f} m above the floor, expected {LOWEST_M:g} "
                f"to {HIGHEST_M:g} m: pass --mount HEIGHT_M,PITCH_DEG"
            )
        height_sigma = round(height_sigma, 3)  # as files store it, so that a replay weights the guess alike
        height_how = f"{count} objects of usual sizes"
        height_how = height_how if count else "usual for a robot; no object of a known size was seen"
    how = (focal_how, height_how, pitch_how)
    return CameraGuess(lens, Mount(height_m, pitch, roll), focal_sigma, height_sigma, pitch_sigma, how, sway_rad)


def _tilt_by_edges(
    ends: list[Array], lens: Intrinsics, focal_sigma: float
) -> tuple[float, float, float, float, str] | None:
    """The tilt by the edges of all pictures: median pitch and roll, standard deviation of the pitch, that of single
    pictures where the camera sways, all in rad, and the method in words; None where too few show a room."""
    angles = np.array([pitch_roll(up) for up in ups_by_edges(ends, lens)])
    if len(angles) < FEWEST:
        return None
    (pitch, roll), (scatter, roll_scatter) = (pair.tolist() for pair in median_and_scatter(angles))
    # With a wrong focal length the horizon's row gives another pitch.
    sigma = math.hypot(abs(pitch) * focal_sigma, SURE_RAD)
    sways = scatter if roll_scatter > MAXIMUM_SCATTER_RAD else 0.0
    return pitch, roll, sigma, sways, f"the edges of {len(angles)} pictures"


def quarter_turns(pictures: Sequence[Picture], detect: Detector) -> int:
    """Number of quarter turns, counterclockwise, that make the pictures upright; 0 where they are, or where none is
    clearly better: the sum of all scores is CLEAR times as large, and larger in most pictures."""
    tried = pictures[:: max(1, len(pictures) // TRIED)][:TRIED]
    sums = np.array([[_score(picture, turns, detect) for turns in range(4)] for picture in tried])
    if not len(tried):
        return 0
    best = int(sums.sum(axis=0).argmax())
    more, most = sums[:, best].sum() > CLEAR * sums[:, 0].sum(), (sums[:, best] > sums[:, 0]).mean() > 0.5
    return best if more and most else 0


def _score(picture: Picture, turns: int, detect: Detector) -> float:
    return float(detect(np.ascontiguousarray(np.rot90(picture, turns))).scores.sum())
