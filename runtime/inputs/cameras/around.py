"""Wrappers of a camera: they change how frames are read and keep everything else."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.fault import CameraFault, CameraState, FaultKind, FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.budget import Budget, Effort
from edgemap.runtime.inputs.cameras.base import CameraBase
from edgemap.runtime.inputs.cameras.protocol import Camera

TICK_S = 0.5  # longest wait of a read at the pace of the stamps


class CameraAround(CameraBase):
    """A camera that forwards everything to another one. Subclasses override `read`."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera.name, camera.intrinsics, camera.mount)
        self.live, self.size = camera.live, camera.size
        self.rate_hz, self.frame_count = camera.rate_hz, camera.frame_count
        self.truth, self.attitudes, self.wheel = camera.truth, camera.attitudes, camera.wheel
        self.decisions, self.edits = camera.decisions, camera.edits
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
    """Delivers every frame of a file camera at its stamp, never earlier; a slow reader gets them late.

    clock_s, sleep: seconds that only go forward, and waiting them; tests pass their own.
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
        """The next frame, once its stamp has come; None at the end. Raises FrameTimeout where that takes longer."""
        frame, self._ahead = self._ahead or super().read(), None
        if frame is None:
            return None
        if self._start_s is None:
            self._start_s = self._clock_s() - frame.stamp_s
        wait_s = self._start_s + frame.stamp_s - self._clock_s()
        if wait_s > 0:
            self._sleep(min(wait_s, TICK_S))
        if wait_s > TICK_S:  # the reader must see a stop meanwhile
            self._ahead = frame
            raise FrameTimeout(f"{self.name}: the next frame is {wait_s:.1f} s ahead", None, self.state)
        return frame


class BudgetedCamera(CameraAround):
    """Frames are taken and marked as a budget decides; a change is reported as a `CameraFault` that is not counted.

    replayed: what another run's budget decided, which is then kept to. efforts: all decisions so far, as plain values.
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
        """The next frame that is taken, with the inertial samples of those that were not."""
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
                return frame  # nothing is decided: a recording's own marks stand
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
