"""A camera of whose frames a budget takes some, and has some of those searched for objects."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.budget import Budget, Effort
from edgemap.runtime.cameras.around import CameraAround
from edgemap.runtime.cameras.fault import CameraFault, FaultKind
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.frame import Frame


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
        """What is done now."""
        return self._effort or Effort()

    @property
    def status(self) -> str:
        """What is done now, for a status line; empty where everything is."""
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
