"""Cameras, one file each: `open_camera(SPEC)` gives a `Camera`."""

from edgemap.runtime.cameras.open import open_camera
from edgemap.runtime.cameras.protocol import Camera

__all__ = ["Camera", "open_camera"]
