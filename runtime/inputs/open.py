"""SPEC to camera: one line per kind, each kind's module imported when it is asked for."""

from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import error_line, user_path
from edgemap.runtime.inputs.cameras.plugins import load_kind, plugin_kinds
from edgemap.runtime.inputs.cameras.protocol import Camera, Driver, SensorTopics
from edgemap.runtime.inputs.cameras.supervisor import RecoveryRule

UNDERSTOOD = (
    "demo, realsense[:SERIAL], realsense:FILE.db3|.bag, a number or /dev/videoN, an rtsp:// or http(s):// stream, "
    "a video file, a folder of pictures, "
    "a recording FILE.mcap[#/topic], a topic ros2:/camera/image_raw, "
    "or KIND:DIR with KIND one of kitti, tum, c2w, drive, euroc, locobot, yolo"
)
STREAMS = ("rtsp", "rtsps", "http", "https")
KINDS = ("kitti", "tum", "c2w", "drive", "euroc", "locobot", "yolo")
DEMO = Path(__file__).parent / "demo"


@dataclass(frozen=True, slots=True)
class _Asked:
    """What the user gives beside SPEC, as of `open_camera`."""

    intrinsics: Intrinsics | None
    mount: Mount | None
    recovery: RecoveryRule | None
    topics: SensorTopics
    depth: bool


def open_camera(
    spec: str = "demo",
    *,
    realtime: bool = False,
    intrinsics: Intrinsics | None = None,
    mount: Mount | None = None,
    recovery: RecoveryRule | None = None,
    topics: SensorTopics | None = None,
    depth: bool = True,
) -> Camera:
    """Opens the camera that SPEC names. Intrinsics and mount given here override the source's own.

    realtime: pace a file source by its stamps; live devices need no pacing. recovery: of live devices. topics: further
    sensors, on ROS 2 topics. depth: whether frames include their depth, where the source has any.

    Raises CameraError, one line, for an invalid SPEC or a source that cannot be opened.
    """
    topics = topics or SensorTopics()
    recorded, by_ros = spec.partition("#")[0].endswith(".mcap"), spec.startswith("ros2:")
    if topics.depth and not (recorded or by_ros):
        raise CameraError(f"camera {spec}: a topic of depth goes with pictures of a ROS 2 topic or a recording only")
    camera = _open(spec, _Asked(intrinsics, mount, recovery, topics, depth))
    if not recorded and (topics.wheels or topics.imu):
        try:
            from edgemap.bridges.ros2.dds.camera import Ros2SensorsCamera
            from edgemap.bridges.ros2.dds.node import shared_node

            camera = Ros2SensorsCamera(camera, shared_node(), topics)
        except BaseException:
            camera.close()
            raise
    if realtime and not camera.live:
        from edgemap.runtime.inputs.cameras.wrappers import PacedCamera

        return PacedCamera(camera)
    return camera


def _open(spec: str, asked: _Asked) -> Camera:
    kind, _, rest = spec.partition(":")
    if spec == "demo":
        return _open_drive(f"drive:{DEMO}", spec, asked)
    if kind in KINDS:
        return _open_drive(spec, spec, asked)
    if kind == "realsense":
        return _open_realsense(rest, spec, asked)
    if spec.isdecimal() or spec.startswith("/dev/video"):
        from edgemap.runtime.inputs.cameras.webcam import WebcamDriver

        device = Path(f"/dev/video{spec}" if spec.isdecimal() else spec)
        return _open_live(WebcamDriver(device, spec, asked.intrinsics), asked)
    if kind in STREAMS:
        from edgemap.runtime.inputs.cameras.webcam import StreamDriver

        return _open_live(StreamDriver(spec), asked)
    if kind == "ros2":
        from edgemap.bridges.ros2.dds.camera import Ros2Camera
        from edgemap.bridges.ros2.dds.depth import DepthTopic
        from edgemap.bridges.ros2.dds.node import shared_node

        node = shared_node()
        depth = DepthTopic(node, asked.topics.depth) if asked.depth else None
        return Ros2Camera(node, rest, asked.intrinsics, asked.mount, asked.recovery, depth)
    if spec.partition("#")[0].endswith(".mcap"):
        from edgemap.bridges.ros2.recordings.camera import RecordingCamera

        return RecordingCamera(spec, asked.intrinsics, asked.mount, asked.topics, asked.depth)
    kinds = plugin_kinds()
    if kind in kinds:
        return _open_plugin(kinds[kind], rest, spec, asked)
    path = user_path(spec)
    _refuse_bag(path)
    if spec and path.is_dir():  # an empty SPEC (an unset variable) is not the current folder
        from edgemap.runtime.inputs.cameras.pictures import open_folder

        return open_folder(path, spec, asked.intrinsics, asked.mount)
    if path.is_file():
        from edgemap.runtime.inputs.cameras.pictures import VideoCamera

        return VideoCamera(spec, path, asked.intrinsics, asked.mount)
    understood = UNDERSTOOD + "".join(f", {name}[:ADDRESS]" for name in sorted(kinds))
    if path.suffix or "/" in spec:
        raise CameraError(f"camera {spec!r}: no such file or folder; understood: {understood}")
    raise CameraError(f"camera {spec!r} is not understood; understood: {understood}")


def _refuse_bag(path: Path) -> None:
    """Raises CameraError for what ROS 2 calls a bag where that is no recording that is read."""
    inside = sorted(path.glob("*.mcap")) if (path / "metadata.yaml").is_file() else []
    if inside:
        raise CameraError(f"{path}: the folder of a ROS 2 bag; pass the recording in it, {inside[0]}")
    if path.suffix == ".db3" or ((path / "metadata.yaml").is_file() and any(path.glob("*.db3"))):
        raise CameraError(
            f"{path}: SQLite. A ROS 2 bag converts to MCAP with `ros2 bag convert`; a librealsense recording is "
            f"realsense:{path}"
        )


def _open_drive(spec: str, name: str, asked: _Asked) -> Camera:
    from edgemap.runtime.inputs.cameras.pictures import drive_camera
    from edgemap.runtime.inputs.drives.open import open_drive

    drive = open_drive(spec)
    return drive_camera(drive if asked.depth else replace(drive, depth=()), name, asked.intrinsics, asked.mount)


def _open_realsense(rest: str, name: str, asked: _Asked) -> Camera:
    from edgemap.runtime.inputs.cameras.imu_buffer import ImuCamera
    from edgemap.runtime.inputs.cameras.realsense import RealSenseDriver, is_recording
    from edgemap.runtime.inputs.cameras.realsense_recording import RealSenseRecording

    if is_recording(rest):
        return RealSenseRecording(user_path(rest), name, asked.intrinsics, asked.mount, asked.depth)
    driver = RealSenseDriver(name, rest or None, asked.depth)
    return ImuCamera(_open_live(driver, asked), driver.imu)


def _open_plugin(point: EntryPoint, rest: str, spec: str, asked: _Asked) -> Camera:
    """A camera of another package, nothing of which is taken for granted."""
    from edgemap.runtime.inputs.cameras.checked import CheckedCamera

    try:
        source = load_kind(point).open(rest, asked.intrinsics, asked.mount)
        if callable(getattr(source, "read", None)):
            return CheckedCamera(cast(Camera, source), spec)
        if not callable(getattr(source, "open", None)):
            raise CameraError(f"camera {spec}: its package gave a {type(source).__name__}, no Camera and no Driver")
        return _open_live(cast(Driver, source), asked)
    except EdgemapError:
        raise
    except Exception as error:  # another package's code may raise anything
        raise CameraError(f"camera {spec}: does not open ({error_line(error)})") from error


def _open_live(driver: Driver, asked: _Asked) -> Camera:
    from edgemap.runtime.inputs.cameras.live import LiveCamera

    return LiveCamera(driver, asked.intrinsics, asked.mount, asked.recovery)
