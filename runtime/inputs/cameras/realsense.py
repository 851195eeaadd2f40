"""Intel RealSense: colour and depth of a device, with intrinsics and stamps."""

import time
from collections.abc import Callable
from functools import cache
from itertools import product
from types import ModuleType
from typing import Any

import numpy as np

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.runtime.frames.camera import Picture
from edgemap.runtime.frames.errors import CameraError, MissingExtraError
from edgemap.runtime.frames.extras import install_hint
from edgemap.runtime.frames.limits import SILENCE_S
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.cameras.realsense_frames import POLL_MS, aligned_depth, start_motion, started, stop, to_bgr


def import_realsense() -> ModuleType:
    """The librealsense module. Raises MissingExtraError, naming the remedy, where it or libusb is missing."""
    try:
        import pyrealsense2
    except ImportError as error:
        needed = f"librealsense's Python module: {install_hint('realsense')}"
        if "libusb" in str(error):
            needed = "the system library libusb: apt install libusb-1.0-0"
        raise MissingExtraError(f"RealSense needs {needed} ({error})") from None
    _kept_context()
    return pyrealsense2


@cache
def _kept_context() -> Any:
    """A context that lives until the process ends: all contexts share the threads that watch the bus, which therefore
    never stop and start again."""
    import pyrealsense2

    rs: Any = pyrealsense2
    return rs.context()


def lens_of(profile: Any, name: str) -> Intrinsics:
    """Intrinsics of a librealsense video stream profile.

    Raises CameraError for a distortion model that is not a Brown-Conrady one and whose coefficients are not zero.
    """
    lens = profile.as_video_stream_profile().get_intrinsics()
    model, coefficients = lens.model.name, tuple(map(_single, lens.coeffs))
    if not any(coefficients):
        distortion = Distortion()
    elif model in ("brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"):
        distortion = Distortion(model, coefficients)
    else:
        raise CameraError(f"{name}: distortion model {model} with coefficients {list(coefficients)} is not supported")
    fx, fy, cx, cy = map(_single, (lens.fx, lens.fy, lens.ppx, lens.ppy))
    return Intrinsics(lens.width, lens.height, fx, fy, cx, cy, distortion)


def _single(value: float) -> float:
    # librealsense keeps float32: 615.2 comes back as 615.2000122; its shortest text is what was calibrated.
    return float(str(np.float32(value)))


def picture_size(profile: Any) -> tuple[int, int]:
    """(width, height) in px of a librealsense video stream profile."""
    video = profile.as_video_stream_profile()
    return video.width(), video.height()


def devices() -> list[tuple[str, str]]:
    """(serial, name) of each RealSense that is plugged in. Raises MissingExtraError as `import_realsense` does."""
    rs = import_realsense()
    info = rs.camera_info
    return [(d.get_info(info.serial_number), d.get_info(info.name)) for d in _kept_context().query_devices()]


class RealSenseDevice:
    """A running colour stream, with depth if it has librealsense's `align`."""

    def __init__(self, pipeline: Any, profile: Any, name: str, motion: Any, align: Any) -> None:
        self.size = picture_size(profile)
        self.rate_hz: float | None = float(profile.fps())
        self.intrinsics: Intrinsics | None = lens_of(profile, name)
        self._pipeline, self._name, self._motion, self._align = pipeline, name, motion, align

    def grab(self) -> Picture | None:
        """The next colour frame at the device's stamp."""
        there, frames = self._pipeline.try_wait_for_frames(POLL_MS)
        colour = frames.get_color_frame() if there else None
        if not colour:
            return None
        depth = None if self._align is None else aligned_depth(self._align, frames)
        return Picture(colour.get_timestamp() / 1000.0, to_bgr(colour, self._name), depth)

    def close(self) -> None:
        """Stop the streams."""
        try:
            if self._motion is not None:
                self._motion.stop()
        finally:
            stop(self._pipeline)


class RealSenseDriver:
    """The RealSense with this serial number, or the first one: colour, 640x480 at 30 Hz or the nearest mode, and depth
    where the device has it and `depth` is set.

    imu: filled by the device's gyro and accelerometer, where it has them.
    """

    def __init__(self, name: str, serial: str | None = None, depth: bool = True) -> None:
        self.name, self._depth = name, depth
        self._rs = import_realsense()
        self._context = self._rs.context()
        self._serial = serial
        self.imu = ImuBuffer(clock_s=time.monotonic)
        self._opened: Any = None

    def open(self) -> RealSenseDevice:
        """Start the colour stream. Raises CameraError where there is no such device or it does not start."""
        rs, failure = self._rs, None
        config = self.config()
        usual, any_size = (rs.stream.color, 640, 480, rs.format.bgr8, 30), (rs.stream.color,)
        for wish, with_depth in product((usual, any_size), (True, False) if self._depth else (False,)):
            pipeline = rs.pipeline(self._context)
            config.disable_all_streams()
            config.enable_stream(*wish)
            if with_depth:
                config.enable_stream(rs.stream.depth)
            try:
                profile = started(rs, pipeline, config).get_stream(rs.stream.color)
            except RuntimeError as error:
                failure = " ".join(str(error).split())
                continue
            if with_depth and not pipeline.try_wait_for_frames(round(1e3 * SILENCE_S))[0]:
                stop(pipeline)  # without depth no pictures would be delivered either
                continue
            self._opened = pipeline.get_active_profile().get_device()
            try:
                motion = start_motion(rs, self._context, str(self._serial), profile, self.imu)
                align = rs.align(rs.stream.color) if with_depth else None
                return RealSenseDevice(pipeline, profile, self.name, motion, align)
            except Exception:  # whatever the error, the device must be free for the next attempt
                stop(pipeline)
                raise
        raise CameraError(f"{self.name} does not start its colour stream ({failure})")

    def config(self) -> Any:
        """A configuration that names the device. Raises CameraError where there is none."""
        serials = [number for number, _ in devices()]
        if not serials:
            raise CameraError(
                "no RealSense device found (check the cable, a USB 3 port, and librealsense's udev rules)"
            )
        if self._serial is not None and self._serial not in serials:
            raise CameraError(f"no RealSense device with serial {self._serial} found; connected: {', '.join(serials)}")
        self._serial = self._serial or serials[0]  # the same device when it is opened again
        config = self._rs.config()
        config.enable_device(self._serial)
        return config

    def reset(self) -> None:
        """Hardware reset by librealsense: the device leaves the bus and returns."""
        for device in self._context.query_devices():
            if device.get_info(self._rs.camera_info.serial_number) == self._serial:
                device.hardware_reset()

    def watch(self, changed: Callable[[bool], None]) -> None:
        """Call `changed(True)` where any device is connected, `changed(False)` where this one is disconnected."""

        def on_change(event: Any) -> None:
            if self._opened is not None and event.was_removed(self._opened):
                changed(False)
            if len(event.get_new_devices()):
                changed(True)

        self._context.set_devices_changed_callback(on_change)
