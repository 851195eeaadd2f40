"""Base class of cameras that read files, and wrappers that change how frames of another camera are read."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.depth_camera import DepthCamera, DepthRegistration
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.decisions import Decisions
from edgemap.runtime.frames.errors import CameraError, CameraFault, CameraState, FaultKind, FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.frames.trajectory import AttitudeTrack, PoseTrack, Trajectory
from edgemap.runtime.inputs.budget import Budget, Effort
from edgemap.runtime.inputs.cameras.protocol import Camera
from edgemap.runtime.inputs.drives.pictures import readable_depth


class CameraBase:
    """The protocol's fields, all unknown, and `frame` to wrap a picture. Subclasses set `size`, add `read`.

    imu: all inertial samples of a recording; `frame` gives each frame its part. depth: depth pictures on disk, one for
    each picture. depth_camera: their camera, None where they are registered to the pictures.
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
        self.depth_camera: DepthCamera | None = None
        self._registration: DepthRegistration | None = None
        self.wheel: Path | PoseTrack | None = None
        self.decisions: Decisions | None = None
        self.edits: tuple[str, ...] = ()
        self.calibration: dict[str, Any] = {}  # of a recording: source of intrinsics and mount, as in camera.yaml
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
        """The picture as the next delivered frame. Raises CameraError where the intrinsics are for another size.

        depth: in metres, one value per pixel; ignored where its size differs from the picture's.
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

    def depth_of(self, number: int) -> NDArray[np.float32] | None:
        """Depth of the picture with that number, one value per pixel; None where it is missing or unreadable."""
        depth = readable_depth(self.depth[number]) if self.depth else None
        if depth is None or self.depth_camera is None:
            return depth
        if self._registration is None:
            if self.intrinsics is None:
                return None
            self._registration = DepthRegistration(self.depth_camera, self.intrinsics)
        return self._registration.registered(depth)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


TICK_S = 0.5  # longest wait of a read at the pace of the stamps


class CameraAround(CameraBase):
    """A camera that forwards everything to another one. Subclasses override `read`."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera.name, camera.intrinsics, camera.mount)
        self.live, self.size = camera.live, camera.size
        self.rate_hz, self.frame_count = camera.rate_hz, camera.frame_count
        self.truth, self.attitudes, self.wheel = camera.truth, camera.attitudes, camera.wheel
        self.decisions, self.edits = camera.decisions, camera.edits
        self.calibration = getattr(camera, "calibration", {})
        self._camera = camera

    @property
    def state(self) -> CameraState:
        """The state of the wrapped camera."""
        return self._camera.state

    def read(self) -> Frame | None:
        """The next frame of the wrapped camera."""
        return self._camera.read()

    def object_records(self) -> list[dict[str, Any]] | None:
        """The objects of the wrapped camera."""
        return self._camera.object_records()

    def close(self) -> None:
        """Close the wrapped camera."""
        self._camera.close()


class PacedCamera(CameraAround):
    """Delivers every frame of a file camera at its stamp, never earlier; a slow reader receives them late.

    clock_s, sleep: a monotonic clock in seconds, and how to wait; tests pass their own.
    """

    def __init__(
        self,
        camera: Camera,
        clock_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(camera)
        self._clock_s, self._sleep = clock_s, sleep
        self._start_s: float | None = None
        self._ahead: Frame | None = None

    def read(self) -> Frame | None:
        """The next frame at its stamp; None at the end. Raises FrameTimeout after TICK_S without one."""
        frame, self._ahead = self._ahead or super().read(), None
        if frame is None:
            return None
        if self._start_s is None:
            self._start_s = self._clock_s() - frame.stamp_s
        wait_s = self._start_s + frame.stamp_s - self._clock_s()
        if wait_s > 0:
            self._sleep(min(wait_s, TICK_S))
        if wait_s > TICK_S:  # so that a stop is noticed
            self._ahead = frame
            raise FrameTimeout(f"{self.name}: the next frame is {wait_s:.1f} s ahead", None, self.state)
        return frame


class BudgetedCamera(CameraAround):
    """Takes and marks frames as a budget decides. A change is reported as a `CameraFault` that does not count as fault.

    replayed: decisions of another run's budget, which are repeated. efforts: all decisions so far, as plain values.
    """

    def __init__(self, camera: Camera, budget: Budget | None = None, replayed: Sequence[Effort] = ()) -> None:
        super().__init__(camera)
        self.efforts: list[dict[str, Any]] = []
        self._budget, self._replayed = budget, list(replayed)
        self._effort: Effort | None = None
        self._skipped: list[ImuSamples] = []
        self._next = 0  # frame index of the camera behind

    @property
    def effort(self) -> Effort:
        """The current effort."""
        return self._effort or Effort()

    @property
    def status(self) -> str:
        """The current effort as a status line; empty at full effort."""
        return "" if self.effort.full else f", {self.effort}"

    def read(self) -> Frame | None:
        """The next frame that is taken, with the inertial samples of the skipped ones."""
        if self._budget is not None and (decided := self._budget.decide()) is not None:
            effort, why = decided
            self._begin(replace(effort, since=self._next))
            raise CameraFault(FaultKind.EFFORT, f"budget: {why}: {effort}")
        while (frame := super().read()) is not None:
            self._next = frame.index + 1
            while self._replayed and self._replayed[0].since <= frame.index:
                self._begin(self._replayed.pop(0))
            effort = self._effort
            if effort is None and self._budget is None and not self._replayed:
                return frame  # no decision: a recording's own marks stay
            effort = effort or Effort()
            self._skipped.append(frame.imu)
            if effort.takes(frame.index):
                samples, self._skipped = ImuSamples.joined(self._skipped), []
                search = effort.searches(frame.index)
                if self._budget is not None:
                    self._budget.frame(search)
                self._delivered += 1
                return replace(frame, index=self._delivered - 1, imu=samples, search=search)
        return None

    def _begin(self, effort: Effort) -> None:
        self._effort = effort
        self.efforts.append(asdict(effort))
