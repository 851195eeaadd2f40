"""From frames to a map on the robot. What programs that embed it need has its name here, imported when first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.objects.floor_map import FloorMap
    from edgemap.runtime.bundle import Bundle, load_bundle
    from edgemap.runtime.cameras import Camera, open_camera
    from edgemap.runtime.frame import Frame
    from edgemap.runtime.loop_closing import LoopCloser
    from edgemap.runtime.mapper import Mapper
    from edgemap.runtime.odometry import open_odometry
    from edgemap.runtime.pipeline import Pipeline
    from edgemap.runtime.slam import SemanticSlam, StepResult
    from edgemap.runtime.store import bundle_folder

_HOMES = {
    "geometry.camera.floor": ("FloorCamera",),
    "geometry.objects.floor_map": ("FloorMap",),
    "runtime.bundle": ("Bundle", "load_bundle"),
    "runtime.cameras": ("Camera", "open_camera"),
    "runtime.frame": ("Frame",),
    "runtime.loop_closing": ("LoopCloser",),
    "runtime.mapper": ("Mapper",),
    "runtime.odometry": ("open_odometry",),
    "runtime.pipeline": ("Pipeline",),
    "runtime.slam": ("SemanticSlam", "StepResult"),
    "runtime.store": ("bundle_folder",),
}
_HOME = {name: f"edgemap.{module}" for module, names in _HOMES.items() for name in names}

__all__ = [
    "Bundle", "Camera", "FloorCamera", "FloorMap", "Frame", "LoopCloser", "Mapper", "Pipeline", "SemanticSlam",
    "StepResult", "bundle_folder", "load_bundle", "open_camera", "open_odometry",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import what is asked for, the first time (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
