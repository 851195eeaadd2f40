"""From frames to a map on the robot. What programs that embed it need has its name here, imported when first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgemap.geometry.default_map import FloorMap
    from edgemap.geometry.floor import FloorCamera
    from edgemap.runtime.cameras import Camera, open_camera
    from edgemap.runtime.correction import Corrector
    from edgemap.runtime.frame import Frame
    from edgemap.runtime.odometry import open_odometry
    from edgemap.runtime.pipeline import Pipeline, StepResult
    from edgemap.runtime.session import Bundle, load_bundle
    from edgemap.runtime.store import bundle_folder

_HOME = {
    "Bundle": "edgemap.runtime.session",
    "Camera": "edgemap.runtime.cameras",
    "Corrector": "edgemap.runtime.correction",
    "FloorCamera": "edgemap.geometry.floor",
    "FloorMap": "edgemap.geometry.default_map",
    "Frame": "edgemap.runtime.frame",
    "Pipeline": "edgemap.runtime.pipeline",
    "StepResult": "edgemap.runtime.pipeline",
    "bundle_folder": "edgemap.runtime.store",
    "load_bundle": "edgemap.runtime.session",
    "open_camera": "edgemap.runtime.cameras",
    "open_odometry": "edgemap.runtime.odometry",
}

__all__ = [
    "Bundle",
    "Camera",
    "Corrector",
    "FloorCamera",
    "FloorMap",
    "Frame",
    "Pipeline",
    "StepResult",
    "bundle_folder",
    "load_bundle",
    "open_camera",
    "open_odometry",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for, the first time (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
