"""Lists the cameras of this machine (RealSense, V4L2) and of other packages (entry points `edgemap.cameras`)."""

import os
import struct
from dataclasses import dataclass
from pathlib import Path

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.plugins import CAMERAS, load_plugin, plugins
from edgemap.runtime.frames.reading import THEIRS, error_line, one_line

VIDEO_NODES, SYSFS = Path("/dev"), Path("/sys/class/video4linux")


@dataclass(frozen=True, slots=True)
class ConnectedCamera:
    """A connected camera. spec: value for `--camera`. name: reported by the device. knows_lens: it reports intrinsics.

    problem: why it cannot be opened; empty if it can be opened or was not checked.
    """

    kind: str
    spec: str
    name: str
    knows_lens: bool = False
    problem: str = ""


def connected_cameras() -> tuple[list[ConnectedCamera], list[str]]:
    """The connected cameras, and one line for each kind that could not be searched (for example, a missing library)."""
    cameras: list[ConnectedCamera] = []
    notes: list[str] = []
    try:
        from edgemap.runtime.inputs.cameras.realsense import devices

        cameras += [ConnectedCamera("realsense", f"realsense:{serial}", name, True) for serial, name in devices()]
    except EdgemapError as error:
        notes.append(str(error))
    # A RealSense also appears as V4L2 devices, without its intrinsics.
    listed = bool(cameras)
    cameras += [camera for camera in _video_devices() if not (listed and "RealSense" in camera.name)]
    try:
        for kind, point in sorted(plugins(CAMERAS).items()):
            try:
                for address, name in load_plugin(point).found():
                    cameras.append(ConnectedCamera(kind, f"{kind}:{address}" if address else kind, one_line(name)))
            except THEIRS as error:
                known = isinstance(error, EdgemapError)
                notes.append(str(error) if known else f"camera kind {kind!r}: {one_line(error_line(error))}")
    except EdgemapError as error:
        notes.append(str(error))
    return cameras, notes


def _video_devices() -> list[ConnectedCamera]:
    """V4L2 nodes that capture video. A node without permission is listed too, because it cannot be queried."""
    cameras = []
    for node in sorted(VIDEO_NODES.glob("video[0-9]*"), key=lambda path: int(path.name[5:])):
        try:
            name = (SYSFS / node.name / "name").read_text().strip()
        except OSError:
            name = "video device"
        problem = ""
        if not os.access(node, os.R_OK | os.W_OK):
            problem = "no permission; add the user to the group `video` and log in again"
        elif not _captures(node):
            continue
        cameras.append(ConnectedCamera("v4l2", str(node), name, problem=problem))
    return cameras


def _captures(node: Path) -> bool:
    """Whether a node captures video: a USB camera also has nodes for metadata."""
    import fcntl

    answer = bytearray(104)  # linux/videodev2.h: struct v4l2_capability
    try:
        handle = os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return True  # busy, for instance; opening it reports the reason
    try:
        fcntl.ioctl(handle, 0x80685600, answer)  # VIDIOC_QUERYCAP
    except OSError:
        return False
    finally:
        os.close(handle)
    (device_caps,) = struct.unpack_from("I", answer, 88)
    return bool(device_caps & 0x1001)  # V4L2_CAP_VIDEO_CAPTURE, single- or multi-planar
