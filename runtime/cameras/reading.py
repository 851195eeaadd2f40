"""Reading on past what goes wrong, for those who only want frames."""

from collections.abc import Callable

from edgemap.runtime.cameras.fault import CameraFault, FrameTimeout
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.frame import Frame


def next_frame(
    camera: Camera, report: Callable[[CameraFault], None], stopped: Callable[[], bool] = lambda: False
) -> Frame | None:
    """The next frame; None at the end, or when `stopped` says so while there is none. Reports each fault before it."""
    while not stopped():
        try:
            return camera.read()
        except CameraFault as fault:
            report(fault)
        except FrameTimeout:
            continue
    return None
