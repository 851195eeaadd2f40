"""Types of faults in the delivery of frames. Each is counted and reported, and reading continues."""

from enum import StrEnum

from edgemap.runtime.frames.errors import CameraError


class FaultKind(StrEnum):
    """Kind of a fault. `RECOVERED` (end of an outage) and `EFFORT` (a budget's decision) are notices, not faults."""

    LATE = "late"  # silent beyond the stall limit
    FAILED = "failed"  # the device's driver raised an error
    CLOSED = "closed"  # the device does not open
    REMOVED = "removed"  # the system says that the device is gone
    STALE = "stale"  # the same pixels again
    STAMP = "stamp"  # a stamp that stands still or is no number
    CLOCK = "clock"  # stamps that jump
    SIZE = "size"  # a picture of another size
    FORMAT = "format"  # a picture that is not (H, W, 3) uint8
    GREY = "grey"  # a colour camera that turns grey
    DAMAGED = "damaged"  # a picture that cannot be decoded
    RECOVERED = "recovered"
    EFFORT = "effort"


class CameraState(StrEnum):
    """running: frames arrive. degraded: none arrive, and the supervisor recovers the camera. lost: the supervisor has
    given up.
    """

    RUNNING = "running"
    DEGRADED = "degraded"
    LOST = "lost"


class CameraFault(CameraError):
    """One fault of delivery, raised by `Camera.read` instead of a frame; reading may continue."""

    def __init__(self, kind: FaultKind, text: str) -> None:
        super().__init__(text)
        self.kind = kind

    @property
    def counted(self) -> bool:
        """Whether this is a fault, and not news."""
        return self.kind not in (FaultKind.RECOVERED, FaultKind.EFFORT)


class FrameTimeout(CameraError):
    """No frame yet, which is no fault: raised by a live `Camera.read` so that its reader can do something else.

    stamp_s: the time now on the stream's clock, None before the first frame.
    """

    def __init__(self, text: str, stamp_s: float | None, state: CameraState) -> None:
        super().__init__(text)
        self.stamp_s, self.state = stamp_s, state


class CameraLostError(CameraError):
    """A live camera that its supervisor has given up on."""

    exit_code = 3
