"""Base of file cameras: counting, the check of every frame's size against the intrinsics, and closing."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.attitude_track import AttitudeTrack
from edgemap.runtime.frames.decisions import Decisions
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.fault import CameraState
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.frames.trajectory import PoseTrack, Trajectory


class CameraBase:
    """The protocol's fields, all unknown, and `frame` to wrap a picture. Subclasses set `size`, add `read`.

    imu: all inertial samples of a recording, which `frame` deals out. depth: depth pictures on disk, one a picture.
    """

    def __init__(self, name: str, intrinsics: Intrinsics | None = None, mount: Mount | None = None) -> None:
        self.name = printable(name)
        self.live = False
        self.size: tuple[int, int] = (0, 0)
        self.intrinsics: Intrinsics | None = intrinsics
        self.mount: Mount | None = mount
        self.rate_hz: float | None = None
        self.frame_count: int | None = None
        self.truth: Trajectory | None = None
        self.attitudes: AttitudeTrack | None = None
        self.imu: ImuSamples | None = None
        self.depth: Sequence[Path] = ()
        self.wheel: Path | PoseTrack | None = None
        self.decisions: Decisions | None = None
        self.edits: tuple[str, ...] = ()
        self._delivered, self._sampled_s = 0, -math.inf

    @property
    def state(self) -> CameraState:
        """Files are always running."""
        return CameraState.RUNNING

    def read(self) -> Frame | None:
        """The next frame; None at the end. See `Camera.read`."""
        raise NotImplementedError

    def object_records(self) -> list[dict[str, Any]] | None:
        """The true objects; None where unknown. See `Camera.object_records`."""
        return None

    def close(self) -> None:
        """Releases the source; may be called twice."""

    def frame(
        self, image: NDArray[np.uint8], stamp_s: float, name: str, depth: NDArray[np.float32] | None = None
    ) -> Frame:
        """The picture as the next delivered frame. Raises CameraError where its size is not the lens's.

        depth: of its pixels; of another size, it is left out.
        """
        height, width = image.shape[:2]
        lens = self.intrinsics
        if lens is not None and (width, height) != (lens.width, lens.height):
            raise CameraError(f"{name}: picture is {width}x{height}, the intrinsics are for {lens.width}x{lens.height}")
        samples = ImuSamples.none() if self.imu is None else self.imu.between(self._sampled_s, stamp_s)
        if depth is not None and depth.shape != (height, width):
            depth = None
        frame = Frame(self._delivered, stamp_s, image, name, samples, depth)
        self._delivered, self._sampled_s = self._delivered + 1, stamp_s
        return frame

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
