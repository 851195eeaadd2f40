"""What the layouts share: the optional camera file and where stamps come from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.drives.pose_files import check_count, read_stamps

DEFAULT_RATE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class Setup:
    """The camera of a data folder: what `camera.yaml` says, or nothing and the layout's customs."""

    intrinsics: Intrinsics | None
    mount: Mount | None
    rate_hz: float
    world_up: str
    notes: dict[str, Any]


def read_setup(folder: Path, world_up: str, intrinsics: Intrinsics | None = None) -> Setup:
    """The folder's `camera.yaml` if there is one; `world_up` and `intrinsics` are what holds where it says nothing."""
    path = folder / "camera.yaml"
    if not path.is_file():
        return Setup(intrinsics, None, DEFAULT_RATE_HZ, world_up, _assumed_rate())
    file = read_camera_yaml(path)
    notes = {} if file.rate_hz else _assumed_rate()
    return Setup(file.intrinsics, file.mount, file.rate_hz or DEFAULT_RATE_HZ, file.world_up or world_up, notes)


def stamps_for(folder: Path, names: tuple[str, ...], pictures: int, where: Path, rate_hz: float) -> NDArray[np.float64]:
    """Stamps in seconds, one per picture: from the first of the named files that is there, else index / rate."""
    for name in names:
        path = folder / name
        if path.is_file():
            stamps = read_stamps(path)
            check_count(path, len(stamps), pictures, where)
            return stamps
    return np.arange(pictures) / rate_hz


def _assumed_rate() -> dict[str, Any]:
    return {"rate": f"no fps given: {DEFAULT_RATE_HZ:g} Hz assumed"}
