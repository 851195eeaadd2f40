"""Cameras around a camera: they change how its frames are read and keep everything else."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.errors import CameraFault, CameraState, FaultKind, FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.budget import Budget, Effort
from edgemap.runtime.inputs.cameras.protocol import Camera

TICK_S = 0.5  # longest wait of a read at the pace of the stamps


class CameraAround(Camera):
    """A camera that forwards everything to another one. Subclasses override `read`."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera.name)
        vars(self).update({name: getattr(camera, name) for name in Camera.__annotations__})
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
