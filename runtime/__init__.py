"""From frames to a map on the robot. Exports the names that embedding programs need; each is imported on first use."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.objects.floor_map import FloorMap
    from edgemap.runtime.frames.camera import Camera
    from edgemap.runtime.frames.frame import Frame
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.motion.odometry import open_odometry
    from edgemap.runtime.network.bundle import Bundle, load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.loop_closing import LoopCloser
    from edgemap.runtime.step.mapper import Mapper
    from edgemap.runtime.step.pipeline import Pipeline
    from edgemap.runtime.step.slam import SemanticSlam, StepResult

_HOMES = {
    "geometry.camera.floor": ("FloorCamera",),
    "geometry.objects.floor_map": ("FloorMap",),
    "runtime.network.bundle": ("Bundle", "load_bundle"),
    "runtime.frames.camera": ("Camera",),
    "runtime.inputs.open": ("open_camera",),
    "runtime.frames.frame": ("Frame",),
    "runtime.step.loop_closing": ("LoopCloser",),
    "runtime.step.mapper": ("Mapper",),
    "runtime.motion.odometry": ("open_odometry",),
    "runtime.step.pipeline": ("Pipeline",),
    "runtime.step.slam": ("SemanticSlam", "StepResult"),
    "runtime.network.store": ("bundle_folder",),
}
EXPORTS = {name: f"edgemap.{module}" for module, names in _HOMES.items() for name in names}

__all__ = [
    "Bundle", "Camera", "FloorCamera", "FloorMap", "Frame", "LoopCloser", "Mapper", "Pipeline", "SemanticSlam",
    "StepResult", "bundle_folder", "load_bundle", "open_camera", "open_odometry",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import what is asked for, the first time (PEP 562)."""
    if name not in EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(EXPORTS[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
