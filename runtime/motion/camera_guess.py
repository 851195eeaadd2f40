"""A guess of lens and mount, as a run corrects it, states it and keeps it in camera.yaml."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import convert
from edgemap.runtime.motion.odometry_names import HYBRID

TURNS = ("", "90 degrees counterclockwise", "180 degrees", "90 degrees clockwise")  # by quarter turns


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
        lines = [
            f"focal length {lens.fx:.0f} +- {100 * self.focal_sigma:.0f} % px ({focal})",
            f"lens {mount.height_m:.2f} m{above} above the floor ({height})",
            f"pitch {pitch_deg:.1f} +- {math.degrees(self.pitch_sigma_rad):.1f} deg, roll {roll_deg:.1f} deg ({pitch})",
        ]
        if self.sway_rad:
            sway = f"the camera sways by {math.degrees(self.sway_rad):.0f} deg from picture to picture: it is carried"
            lines.append(f"{sway}; pitch and height are not constant")
        if self.quarter_turns:
            lines.append(f"the pictures are not upright: turn them by {TURNS[self.quarter_turns]}")
        return lines

    def scale_sigma(self, odometry: str) -> float:
        """Standard deviation, as a share, of a height that a run corrects together with all lengths. 0 for a configured
        height, for a carried camera, and where the odometry's lengths do not depend on the height."""
        return self.height_sigma if not self.sway_rad and odometry == HYBRID else 0.0

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
    def of_record(
        cls,
        calibration: Mapping[str, Any],
        lens: Intrinsics,
        mount: Mount,
        where: str,
        stated: Collection[str] = (),
    ) -> "CameraGuess | None":
        """The guess in `calibration` of a camera.yaml, without values that were calibrated or edited since; None where
        none is left. where: the file's name for messages. stated: what the user states instead, of intrinsics, mount
        and height. Raises CameraError.
        """
        if calibration.get("method") != "guessed":
            return None
        record = convert(calibration, _Record, f"{where}: calibration", CameraError, strict=False)
        known, tilted = {*calibration, *stated}, "tilt" in calibration
        focal = 0.0 if "intrinsics" in known else record.focal_sigma_share
        height = 0.0 if known & {"mount", "height"} else record.height_sigma_share
        pitch, sway = (0.0, 0.0) if "mount" in known else (record.sigma_pitch_deg * (not tilted), record.sway_deg)
        if not focal and not height and not pitch:
            return None
        how = (f"as in {where}",) * 3
        return cls(lens, mount, focal, height, math.radians(pitch), how, math.radians(sway))
