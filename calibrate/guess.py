"""A first guess of intrinsics and mount of an uncalibrated camera, from its pictures and the objects in them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from edgemap.calibrate.guess_focal import (
    FEWEST_ROOMS,
    SWAYING_RAD,
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
from edgemap.geometry.camera.level import pitch_roll
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.robust import median_and_scatter
from edgemap.runtime.frames.errors import CalibrationError, CameraError
from edgemap.runtime.frames.reading import convert
from edgemap.runtime.motion.attitude.segments import line_ends
from edgemap.runtime.motion.odometry_names import PICTURE_ODOMETRIES

# Of a pitch by edges with the right focal length: 0.34 degrees RMS on twelve rendered homes, where the pitch by sizes
# errs by 3 degrees.
SURE_RAD = math.radians(0.35)
LOWEST_M, HIGHEST_M = 0.05, 3.0
TURNS = ("", "90 degrees counterclockwise", "180 degrees", "90 degrees clockwise")  # by quarter turns
LEAST_FLOOR = 0.1  # share of the picture below the horizon

Picture = NDArray[np.uint8]
Detector = Callable[[Picture], Detections]


class _Record(msgspec.Struct):
    """A guess as in `calibration` of a camera.yaml; files of an older edgemap or written by hand have fewer fields."""

    focal_sigma_share: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    height_sigma_share: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    sigma_pitch_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] = 0.0
    sway_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] = 0.0


@dataclass(frozen=True, slots=True)
class CameraGuess:
    """Guessed lens and mount. focal_sigma, height_sigma: standard deviations as a share; pitch_sigma_rad: of the pitch;
    0 for a value that was not guessed. how: the source of each value, in words. sway_rad: standard deviation of the
    pitch of a carried camera, else 0. quarter_turns: counterclockwise turns that make the pictures upright."""

    lens: Intrinsics
    mount: Mount
    focal_sigma: float
    height_sigma: float
    pitch_sigma_rad: float
    how: tuple[str, ...]
    sway_rad: float = 0.0
    quarter_turns: int = 0

    def lines(self) -> list[str]:
        """The guess with its uncertainty, for display."""
        lens, mount = self.lens, self.mount
        focal, height, pitch = self.how
        above = f" +- {100 * self.height_sigma:.0f} %" if self.height_sigma else ""
        pitch_deg, roll_deg = math.degrees(mount.pitch_rad), math.degrees(mount.roll_rad)
        sway = f"the camera sways by {math.degrees(self.sway_rad):.0f} deg from picture to picture: it is carried"
        return [
            f"focal length {lens.fx:.0f} +- {100 * self.focal_sigma:.0f} % px ({focal})",
            f"lens {mount.height_m:.2f} m{above} above the floor ({height})",
            f"pitch {pitch_deg:.1f} +- {math.degrees(self.pitch_sigma_rad):.1f} deg, roll {roll_deg:.1f} deg ({pitch})",
            *([f"{sway}; pitch and height are not constant"] if self.sway_rad else []),
            *(
                [f"the pictures are not upright: turn them by {TURNS[self.quarter_turns]}"]
                if self.quarter_turns
                else []
            ),
        ]

    def scale_sigma(self, odometry: str) -> float:
        """Standard deviation, as a share, of a height that a run corrects together with all lengths. 0 for a configured
        height, for a carried camera, and where the odometry's lengths do not depend on the height."""
        return self.height_sigma if not self.sway_rad and odometry in PICTURE_ODOMETRIES else 0.0

    def record(self) -> dict[str, object]:
        """The guess as in run.json, and in `calibration` of a camera.yaml."""
        record: dict[str, object] = {
            "method": "guessed",
            "focal_sigma_share": round(self.focal_sigma, 3),
            "height_sigma_share": round(self.height_sigma, 3),
            "sigma_pitch_deg": round(math.degrees(self.pitch_sigma_rad), 2),
            "from": list(self.how),
        }
        record |= {"sway_deg": round(math.degrees(self.sway_rad), 1)} if self.sway_rad else {}
        return record | ({"turned_by": TURNS[self.quarter_turns]} if self.quarter_turns else {})

    @classmethod
    def of_record(cls, calibration: dict[str, Any], lens: Intrinsics, mount: Mount, where: str) -> "CameraGuess | None":
        """The guess in `calibration` of a camera.yaml, without values that were calibrated or edited since; None where
        none is left. where: the file's name for messages. Raises CameraError.
        """
        if calibration.get("method") != "guessed":
            return None
        record = convert(calibration, _Record, f"{where}: calibration", CameraError, strict=False)
        focal = 0.0 if "intrinsics" in calibration else record.focal_sigma_share
        height, pitch, sway = record.height_sigma_share, record.sigma_pitch_deg, record.sway_deg
        if "mount" in calibration:
            height = pitch = sway = 0.0
        pitch = 0.0 if "tilt" in calibration else pitch
        if not focal and not height and not pitch:
            return None
        how = (f"as in {where}",) * 3
        return cls(lens, mount, focal, height, math.radians(pitch), how, math.radians(sway))


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
    height_m: float | None = None,
) -> CameraGuess:
    """Lens and mount of the camera that took these pictures.

    Focal length: as stated by the files, else from the usual field of view and the room's edges (three directions
    become orthogonal at the correct one). Pitch and roll: from the room's edges, else the angles at which objects of
    usual heights agree. Height: objects of usual heights. lens, mount, height_m: configured values, which stay. Raises
    CalibrationError, with the numbers, for pictures without floor, or a lens outside 0.05 to 3 m above it.
    """
    if not pictures:
        raise CalibrationError("no picture came to guess the camera from")
    height, width = pictures[0].shape[:2]
    ends = [line_ends(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) for picture in pictures]
    focal_sigma, focal_how = 0.0, "as given"
    if lens is None:
        share, focal_sigma, bend, focal_how = focal_by_edges(ends, width, height)
        if stated is not None:
            share, focal_sigma, bend, focal_how = stated.px / max(width, height), stated.sigma, 0.0, stated.source
        lens = plain_lens(width, height, share, bend)
    boxes = [detect(picture) for picture in pictures]
    if mount is not None:
        return CameraGuess(lens, mount, focal_sigma, 0.0, 0.0, (focal_how, "as given", "as given"))
    edges = _tilt_by_edges(ends, lens, focal_sigma)
    roll, sway_rad = (edges.roll_rad, edges.sway_rad) if edges else (0.0, 0.0)
    if edges and not sway_rad:
        pitch, pitch_sigma, pitch_how = edges.pitch_rad, edges.sigma_rad, edges.how
    else:
        pitch, pitch_sigma, count = pitch_by_sizes(boxes, lens, (CARRIED_HEIGHT_M, CARRIED_SIGMA) if sway_rad else None)
        pitch_how = f"{count} objects of usual sizes" if count else "usual for a robot"
    if edges and sway_rad:  # a person who walks looks up and down: edges show the level pictures
        weights = np.array([pitch_sigma, math.hypot(edges.sigma_rad, sway_rad)]) ** -2
        pitch = float(weights @ [pitch, edges.pitch_rad] / weights.sum())
        pitch_sigma, pitch_how = math.hypot(weights.sum() ** -0.5, sway_rad), f"{edges.how}, {pitch_how}"
    tilted = Mount(1.0, pitch, roll)
    floor_share = _floor_share(lens, tilted)
    if floor_share < LEAST_FLOOR:
        raise CalibrationError(
            f"{100 * floor_share:.0f} % of the picture lies below the horizon (pitch {math.degrees(pitch):.1f} deg up "
            f"to {math.degrees(pitch_sigma):.1f}): no floor is seen; tilt the camera down, or pass --mount"
        )
    if height_m is not None:
        how = (focal_how, "as given", pitch_how)
        return CameraGuess(lens, Mount(height_m, pitch, roll), focal_sigma, 0.0, pitch_sigma, how, sway_rad)
    if sway_rad:  # the tilt of single pictures is too uncertain for sizes
        how = (focal_how, "as a person carries it", pitch_how)
        mount = Mount(CARRIED_HEIGHT_M, pitch, roll)
        return CameraGuess(lens, mount, focal_sigma, CARRIED_SIGMA, pitch_sigma, how, sway_rad)
    height_m, height_sigma, count = height_by_sizes(boxes, lens, tilted, pitch_sigma, (USUAL_HEIGHT_M, HEIGHT_SIGMA))
    if not LOWEST_M <= height_m <= HIGHEST_M:
        raise CalibrationError(
            f"{count} objects of usual sizes put the lens {height_m:.2f} m above the floor, expected {LOWEST_M:g} to "
            f"{HIGHEST_M:g} m: pass --mount HEIGHT_M,PITCH_DEG"
        )
    height_sigma = round(height_sigma, 3)  # as files store it, so that a replay weights the guess alike
    how = f"{count} objects of usual sizes" if count else "usual for a robot; no object of a known size was seen"
    how = (focal_how, how, pitch_how)
    return CameraGuess(lens, Mount(height_m, pitch, roll), focal_sigma, height_sigma, pitch_sigma, how)


@dataclass(frozen=True, slots=True)
class _EdgesTilt:
    """Median pitch and roll, standard deviation of the pitch, and that of single pictures where the camera sways."""

    pitch_rad: float
    roll_rad: float
    sigma_rad: float
    sway_rad: float
    how: str


def _tilt_by_edges(ends: list[Array], lens: Intrinsics, focal_sigma: float) -> _EdgesTilt | None:
    """The tilt by the edges of all pictures; None where too few show a room."""
    angles = np.array([pitch_roll(up) for up in ups_by_edges(ends, lens)])
    if len(angles) < FEWEST_ROOMS:
        return None
    (pitch, roll), (scatter, roll_scatter) = (found.tolist() for found in median_and_scatter(angles))
    # With a wrong focal length the horizon's row gives another pitch.
    sigma = math.hypot(abs(pitch) * focal_sigma, SURE_RAD)
    return _EdgesTilt(
        pitch, roll, sigma, scatter if roll_scatter > SWAYING_RAD else 0.0, f"the edges of {len(angles)} pictures"
    )


def _floor_share(lens: Intrinsics, mount: Mount) -> float:
    """Share of the picture's height below the horizon, in the middle column."""
    row = FloorCamera(lens, mount).horizon_row()
    return float(np.clip((lens.height - row) / lens.height, 0.0, 1.0))
