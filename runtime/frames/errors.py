"""The runtime's known failures; each message is one line with what, where, and the numbers."""

from edgemap.geometry.errors import EdgemapError, MapError


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


class RecordingError(EdgemapError):
    """A recording cannot be written, or would overwrite an existing file."""


class PublishError(EdgemapError):
    """A live output cannot be opened, or its peer has disconnected."""


class Ros2Error(EdgemapError):
    """ROS 2 that cannot be spoken: a name, a setting of discovery, or DDS itself."""


class CalibrationError(EdgemapError):
    """Pictures from which a lens or a mount cannot be determined well enough."""
