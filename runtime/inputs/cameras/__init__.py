"""Cameras, one file each, and what supervises them; `edgemap.runtime.inputs.open` makes one of a SPEC."""

from importlib import import_module
from typing import Any

from edgemap.runtime.inputs.cameras.protocol import Camera

__all__ = ["Camera"]


def __getattr__(name: str) -> Any:
    """`open_camera` under its former name; it stands above this package."""
    if name != "open_camera":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("edgemap.runtime.inputs.open").open_camera
