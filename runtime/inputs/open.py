"""SPEC to camera: one line per kind, each kind's module imported when it is asked for."""

from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraOptions, Driver
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.notes import collected
from edgemap.runtime.frames.plugins import CAMERAS, load_plugin, plugins
from edgemap.runtime.frames.reading import THEIRS, error_line, user_path
from edgemap.runtime.inputs.cameras.kinds import kind_of

UNDERSTOOD = (
    "demo, realsense[:SERIAL], realsense:FILE.db3|.bag, a number or /dev/videoN, an rtsp:// or http(s):// stream, "
    "a video file, a folder of pictures, "
    "a recording FILE.mcap|.db3|.bag[#/topic] or the folder of a bag, a topic ros2:/camera/image_raw, sim:SEED, "
    "or KIND:DIR with KIND one of kitti, tum, c2w, drive, euroc, locobot, yolo"
)
STREAMS = ("rtsp", "rtsps", "http", "https")
KINDS = ("kitti", "tum", "c2w", "drive", "euroc", "locobot", "yolo")
DEMO = Path(__file__).parent / "demo"


def open_camera(spec: str = "demo", how: CameraOptions = CameraOptions()) -> Camera:  # noqa: B008
    """Opens the camera that SPEC names.

    Raises CameraError or PluginError, one line, for an invalid SPEC or a source that cannot be opened.
    """
    with collected() as faults:
        camera = _open(spec, how)
    if faults:
        camera.update_info(faults=(*camera.info.faults, *faults))
    if how.realtime and not camera.info.live:
        from edgemap.runtime.inputs.cameras.wrappers import PacedCamera

        return PacedCamera(camera)
    return camera


def _open(spec: str, how: CameraOptions) -> Camera:
    kind, _, rest = spec.partition(":")
    plugin = kind_of(spec)
    if how.topics.depth and plugin is None:
        raise CameraError(f"camera {spec}: a topic of depth goes with pictures of a ROS 2 topic or a recording only")
    if spec == "demo":
        return _open_drive(f"drive:{DEMO}", spec, how)
    if kind in KINDS:
        return _open_drive(spec, spec, how)
    if kind == "realsense":
        return _open_realsense(rest, spec, how)
    if spec.isdecimal() or spec.startswith("/dev/video"):
        from edgemap.runtime.inputs.cameras.webcam import WebcamDriver

        device = Path(f"/dev/video{spec}" if spec.isdecimal() else spec)
        return _open_live(WebcamDriver(device, spec, how.intrinsics), how)
    if kind in STREAMS:
        from edgemap.runtime.inputs.cameras.webcam import StreamDriver

        return _open_live(StreamDriver(spec), how)
    if plugin is not None:
        return _open_plugin(*plugin, spec, how)
    path = user_path(spec)
    if spec and path.is_dir():  # an empty SPEC (an unset variable) is not the current folder
        from edgemap.runtime.inputs.cameras.pictures import open_folder

        return open_folder(path, spec, how.intrinsics, how.mount)
    if path.is_file():
        from edgemap.runtime.inputs.cameras.pictures import VideoCamera

        return VideoCamera(spec, path, how.intrinsics, how.mount)
    others = (name for name in sorted(plugins(CAMERAS)) if name not in UNDERSTOOD)
    understood = UNDERSTOOD + "".join(f", {name}[:ADDRESS]" for name in others)
    if path.suffix or "/" in spec:
        raise CameraError(f"camera {spec!r}: no such file or folder; understood: {understood}")
    raise CameraError(f"camera {spec!r} is not understood; understood: {understood}")


def _open_drive(spec: str, name: str, how: CameraOptions) -> Camera:
    from edgemap.runtime.inputs.cameras.pictures import drive_camera
    from edgemap.runtime.inputs.drives.open import open_drive

    drive = open_drive(spec)
    return drive_camera(drive if how.depth else replace(drive, depth=()), name, how.intrinsics, how.mount)


def _open_realsense(rest: str, name: str, how: CameraOptions) -> Camera:
    from edgemap.runtime.inputs.cameras.imu_buffer import ImuCamera
    from edgemap.runtime.inputs.cameras.realsense import RealSenseDriver
    from edgemap.runtime.inputs.cameras.realsense_recording import RealSenseRecording

    if rest.endswith((".db3", ".bag")) or "/" in rest:  # no serial number
        return RealSenseRecording(user_path(rest), name, how)
    driver = RealSenseDriver(name, rest or None, how.depth)
    return ImuCamera(_open_live(driver, how), driver.imu)


def _open_plugin(point: EntryPoint, address: str, spec: str, how: CameraOptions) -> Camera:
    """A camera of an entry point, of which nothing is taken for granted."""
    from edgemap.runtime.inputs.cameras.checked import CheckedCamera

    try:
        source = load_plugin(point).open(address, how)
        if callable(getattr(source, "read", None)):
            ours = point.dist is not None and point.dist.name == "edgemap-robot"  # replays a recording bit for bit
            return cast(Camera, source) if ours else CheckedCamera(source, spec)
        if not callable(getattr(source, "open", None)):
            raise CameraError(f"camera {spec}: its package gave a {type(source).__name__}, no Camera and no Driver")
        return _open_live(cast(Driver, source), how)
    except EdgemapError:
        raise
    except THEIRS as error:
        raise CameraError(f"camera {spec}: does not open ({error_line(error)})") from error


def _open_live(driver: Driver, how: CameraOptions) -> Camera:
    from edgemap.runtime.inputs.cameras.live import LiveCamera

    return LiveCamera(driver, how.intrinsics, how.mount, how.recovery)
