"""Sources of the camera's tilt in each step."""

from __future__ import annotations

from typing import Protocol

from edgemap.geometry.camera.attitude import Attitude, SeenRotation
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frame import Frame


class AttitudeSource(Protocol):
    """Fed every frame in order; depends on frames, their stamps and their IMU samples only."""

    name: str

    def step(self, frame: Frame) -> Attitude:
        """The camera's attitude at this frame."""
        ...

    def rotated(self, rotation: SeenRotation | None) -> Attitude:
        """The last frame's attitude where `step` could only predict it, once its rotation is seen; None where no corner
        showed it."""
        ...

    def correct_mount(self, mount: Mount) -> None:
        """From now on the mount has these angles."""
        ...

    def reset(self, reason: str) -> None:
        """Forget the past."""
        ...
