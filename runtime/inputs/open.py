"""SPEC to camera: one line per kind."""

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

import numpy as np

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraOptions, Driver
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import collected
from edgemap.runtime.frames.plugins import CAMERAS, load_plugin, plugins
from edgemap.runtime.frames.reading import THEIRS, error_line, user_path
from edgemap.runtime.inputs.cameras.checked import CheckedCamera
from edgemap.runtime.inputs.cameras.imu_buffer import ImuCamera
from edgemap.runtime.inputs.cameras.kinds import kind_of
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.cameras.realsense import RealSenseDriver
from edgemap.runtime.inputs.cameras.realsense_recording import open_recording
from edgemap.runtime.inputs.cameras.webcam import StreamDriver, WebcamDriver
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera, RotatedCamera
from edgemap.runtime.inputs.drives.drive import Drive, ridden
from edgemap.runtime.inputs.drives.layout import drive_of
from edgemap.runtime.inputs.drives.open import READERS, open_drive
from edgemap.runtime.inputs.drives.pictures import list_pictures

UNDERSTOOD = (
    "demo, realsense[:SERIAL], realsense:FILE.db3|.bag, a number or /dev/videoN, an rtsp:// or http(s):// stream, "
    "a video file, a folder of pictures, "
    "a recording FILE.mcap|.db3|.bag[#/topic] or the folder of a bag, a topic ros2:/camera/image_raw, sim:SEED, "
    f"or KIND:DIR with KIND one of {', '.join(READERS)}"
)
STREAMS = ("rtsp", "rtsps", "http", "https")
DEMO = Path(__file__).parent / "demo"


def open_camera(
    spec: str = "demo",
    how: CameraOptions = CameraOptions(),  # noqa: B008
    with_sensors: Callable[[Camera], Camera] = lambda camera: camera,
) -> Camera:
    """Opens the camera that SPEC names. with_sensors: adds those of other programs, before pictures are turned.

    Raises CameraError or PluginError, one line, for an invalid SPEC or a source that cannot be opened.
    """
    with collected() as faults:
        camera = _open(spec, replace(how, intrinsics=how.intrinsics and how.intrinsics.rotated(-how.rotate)))
    camera.update_info(faults=(*camera.info.faults, *faults))
    camera = with_sensors(PacedCamera(camera) if how.realtime and not camera.info.live else camera)
    return RotatedCamera(camera, how.rotate) if how.rotate else camera


def _open(spec: str, how: CameraOptions) -> Camera:
    kind, _, rest = spec.partition(":")
    plugin = kind_of(spec)
    if how.topics.depth and plugin is None:
        raise CameraError(f"camera {spec}: a topic of depth goes with pictures of a ROS 2 topic or a recording only")
    if spec == "demo":
        return _open_files(open_drive(f"drive:{DEMO}"), spec, how)
    if kind in READERS:
        return _open_files(open_drive(spec), spec, how)
    if kind == "realsense":
        return _open_realsense(rest, spec, how)
    if spec.isdecimal() or spec.startswith("/dev/video"):
        device = Path(f"/dev/video{spec}" if spec.isdecimal() else spec)
        return LiveCamera(WebcamDriver(device, spec, how.intrinsics), how)
    if kind in STREAMS:
        return LiveCamera(StreamDriver(spec), how)
    if plugin is not None:
        return _open_plugin(*plugin, spec, how)
    path = user_path(spec)
    if spec and path.is_dir():  # an empty SPEC (an unset variable) is not the current folder
        return _open_files(drive_of("", path, list_pictures(path)), spec, how)
    if path.is_file():
        return _open_files(Drive("", path.parent, (), np.zeros(0), video=path), spec, how)
    others = (name for name in sorted(plugins(CAMERAS)) if name not in UNDERSTOOD)
    understood = UNDERSTOOD + "".join(f", {name}[:ADDRESS]" for name in others)
    if path.suffix or "/" in spec:
        raise CameraError(f"camera {spec!r}: no such file or folder; understood: {understood}")
    raise CameraError(f"camera {spec!r} is not understood; understood: {understood}")


def _open_files(drive: Drive, name: str, how: CameraOptions) -> Camera:
    """Files as a camera, with lens and mount as stated. A stated mount does not move the truth: that was taken to the
    turn axis by the drive's lever arm."""
    lens, mount = how.intrinsics or drive.intrinsics, ridden(drive.kind, how.mount or drive.mount)
    return drive_camera(replace(drive, intrinsics=lens, mount=mount, depth=drive.depth if how.depth else ()), name)


def _open_realsense(rest: str, name: str, how: CameraOptions) -> Camera:
    if rest.endswith((".db3", ".bag")) or "/" in rest:  # no serial number
        return open_recording(user_path(rest), name, how)
    driver = RealSenseDriver(name, rest or None, how.depth)
    return ImuCamera(LiveCamera(driver, how), driver.imu)


def _open_plugin(point: EntryPoint, address: str, spec: str, how: CameraOptions) -> Camera:
    """A camera of an entry point, of which nothing is taken for granted."""
    try:
        source = load_plugin(point).open(address, how)
        if callable(getattr(source, "read", None)):
            ours = point.dist is not None and point.dist.name == "edgemap-robot"  # replays a recording bit for bit
            return cast(Camera, source) if ours else CheckedCamera(source, spec)
        if not callable(getattr(source, "open", None)):
            raise CameraError(f"camera {spec}: its package gave a {type(source).__name__}, no Camera and no Driver")
        return LiveCamera(cast(Driver, source), how)
    except EdgemapError:
        raise
    except THEIRS as error:
        raise CameraError(f"camera {spec}: does not open ({error_line(error)})") from error
