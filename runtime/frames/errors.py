"""The runtime's failures: each message is one line with what, where, and the numbers."""

from enum import StrEnum

from edgemap.geometry.errors import EdgemapError, MapError
from edgemap.runtime.frames.faults import Fault, FaultKind


class CameraError(EdgemapError):
    """A camera, recording or data folder that cannot be opened or read."""


class BundleError(EdgemapError):
    """A bundle that is missing, damaged, or breaks the contract."""


class OdometryError(EdgemapError):
    """An odometry that is unknown, lacking, untrained, or fed with unusable data."""


class MissingExtraError(EdgemapError):
    """An optional part of the installation is needed; the message names it."""


class RunFolderError(EdgemapError):
    """A run folder that cannot be written, or that holds another run already."""


class DiskError(MapError):
    """A file cannot be written: the disk is full, read-only, or missing."""

    exit_code = 4


class BridgeError(EdgemapError):
    """What leads to other programs fails: a recording or a picture cannot be written, a live output cannot be opened or
    has lost its peer, or ROS 2 cannot be spoken (a name, a setting of discovery, DDS itself)."""


class CalibrationError(EdgemapError):
    """Pictures from which a lens or a mount cannot be determined well enough."""


class CameraState(StrEnum):
    """running: frames arrive. degraded: none arrive, and the supervisor recovers the camera. lost: the supervisor has
    stopped.
    """

    RUNNING = "running"
    DEGRADED = "degraded"
    LOST = "lost"


class UsageError(EdgemapError):
    """Text of an option that cannot be used: wrong usage, which no repetition mends."""

    exit_code = 2


class PluginError(EdgemapError):
    """A plugin of another package that does not load, or two that have one name."""


class CameraFault(CameraError):
    """One fault of delivery, raised by `Camera.read` instead of a frame; reading may continue."""

    def __init__(self, kind: FaultKind, text: str) -> None:
        super().__init__(text)
        self.kind, self.fault = kind, Fault(kind, text)


class FrameTimeout(CameraError):
    """No frame yet, which is not a fault: raised by a live `Camera.read` so that its reader can do something else.

    stamp_s: the time now on the stream's clock, None before the first frame.
    """

    def __init__(self, text: str, stamp_s: float | None, state: CameraState) -> None:
        super().__init__(text)
        self.stamp_s, self.state = stamp_s, state


class CameraLostError(CameraError):
    """A live camera whose restart budget is spent."""

    exit_code = 3
