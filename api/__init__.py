"""edgemap: a map of the objects on the floor from one camera on two CPU cores.

`edgemap.open(camera=…)`, `edgemap.open(frames=…)` and `session.push(image, stamp_s)` are the whole product,
`edgemap.load(path)` a saved map; `edgemap.runtime` has its parts.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from edgemap.runtime.frames.version import VERSION

if TYPE_CHECKING:
    from edgemap.opening import GuessWarning
    from edgemap.opening import open_session as open
    from edgemap.runtime.outputs.map_objects import MapObjects
    from edgemap.runtime.outputs.map_objects import load_map_objects as load
    from edgemap.runtime.session import Session

# onnxruntime 1.31 and later send events about sessions to their maker, and keep a device id in the user's cache, unless
# this stands in the environment before they are imported. Whoever wants that sets it to 0.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# Read by OpenCV when it is imported: the largest picture that it decodes (67 million px, 200 MB as BGR), and logs of
# OpenCV and FFmpeg off the terminal, where edgemap reports what they refuse.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 26))
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

__version__ = VERSION
__all__ = ["GuessWarning", "MapObjects", "Session", "__version__", "load", "open"]
_HOMES = {
    "GuessWarning": "opening:GuessWarning",
    "MapObjects": "runtime.outputs.map_objects:MapObjects",
    "Session": "runtime.session:Session",
    "load": "runtime.outputs.map_objects:load_map_objects",
    "open": "opening:open_session",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for, the first time (PEP 562)."""
    if name in _HOMES:
        module, _, member = _HOMES[name].partition(":")
        return getattr(import_module(f"edgemap.{module}"), member)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """What tab completion offers."""
    return sorted(__all__)
