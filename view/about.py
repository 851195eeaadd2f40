"""What the page must know of a run before its first step."""

import math
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import CHI2_95
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.colours import SHAPES, label_mark
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.inputs.drives.camera_yaml import mount_fields
from edgemap.runtime.network.bundle import Bundle


def about_run(
    source: Camera, bundle: Bundle, floor: FloorCamera, odometry: str, folder: Path, frames: int | None
) -> dict[str, Any]:
    """Description of the run, with the camera's calibration for drawing. frames: how many the run takes at most, None
    where nobody knows."""
    lens = floor.intrinsics
    return {
        "camera": source.info.name,
        "live": source.info.live,
        "frames": frames,
        "rate_hz": source.info.rate_hz,
        "bundle": bundle.manifest.name,
        "odometry": odometry,
        "folder": printable(folder),
        "picture_px": [lens.width, lens.height],
        "view_rad": 2.0 * math.atan2(lens.width / 2.0, lens.fx),
        "lens": {name: getattr(lens, name) for name in ("fx", "fy", "cx", "cy")}
        | {"distortion": asdict(lens.distortion)},
        "mount": mount_fields(floor.mount),
        "marks": {name: asdict(label_mark(name)) for name in bundle.names},
        "shapes": SHAPES,
        "chi2_95": CHI2_95,
        "run": f"{time.time_ns():x}",
    }
