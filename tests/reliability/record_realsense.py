"""Records pictures, depth and motion as a RealSense would, through librealsense's own software device and recorder."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.open import open_camera

rs: Any = pyrealsense2  # its type stubs lack most of it

FX, FY, CX, CY = 615.2, 615.4, 321.1, 239.7
Lens = tuple[float, float, float, float]


def software_device(number: int) -> Any:
    """A device without hardware."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software RealSense")
    device.register_info(rs.camera_info.serial_number, f"{number:012d}")
    return device


def video_stream(
    size: tuple[int, int],
    lens: Lens,
    pixel_format: Any = rs.format.rgb8,
    bytes_per_pixel: int = 3,
    kind: Any = rs.stream.color,
    uid: int = 1,
    fps: int = 30,
    model: Any = rs.distortion.inverse_brown_conrady,
    coefficients: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> Any:
    """A stream of pictures of this size, (width, height)."""
    intrinsics, stream = rs.intrinsics(), rs.video_stream()
    intrinsics.width, intrinsics.height = stream.width, stream.height = size
    intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = lens
    intrinsics.model, intrinsics.coeffs = model, list(coefficients)
    stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, fps
    stream.bpp, stream.fmt, stream.intrinsics = bytes_per_pixel, pixel_format, intrinsics
    return stream


def stamped(frame: Any, profile: Any, stamp_s: float, number: int) -> Any:
    """The frame with its stream, stamp and number."""
    frame.timestamp, frame.domain = stamp_s * 1000.0, rs.timestamp_domain.hardware_clock
    frame.frame_number, frame.profile = number, profile
    return frame


def send(sensor: Any, profile: Any, picture: np.ndarray, stamp_s: float, number: int, **fields: Any) -> None:
    """A sensor delivers a picture, (H, W) or (H, W, C)."""
    frame = stamped(rs.software_video_frame(), profile.as_video_stream_profile(), stamp_s, number)
    frame.bpp = picture.nbytes // (picture.shape[0] * picture.shape[1])
    frame.stride = picture.shape[1] * frame.bpp
    frame.pixels = np.ascontiguousarray(picture)
    for name, value in fields.items():
        setattr(frame, name, value)
    sensor.on_video_frame(frame)


@contextmanager
def recording(path: Path, device: Any, end_s: float = 0.2) -> Iterator[None]:
    """What the device's sensors deliver in the block is recorded; the recorder writes on a thread of its own."""
    recorder = rs.recorder(str(path), device)
    sensors = recorder.query_sensors()
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(lambda frame: None)
    yield
    time.sleep(end_s)
    for sensor in sensors:
        sensor.stop()
        sensor.close()


def record_realsense(
    path: Path,
    pictures: Sequence[np.ndarray],
    stamps_s: Sequence[float],
    stream_format: Any = rs.format.rgb8,
    lens: Lens = (FX, FY, CX, CY),
    pause_s: float = 0.004,
    stream: Any = rs.stream.color,
    **options: Any,
) -> Path:
    """Write a `.db3`: pictures in the stream's own format, (H, W, C) uint8, at the stamps in seconds.

    pause_s: between two pictures, in real time: the recorder drops what it does not come to on a busy machine.
    """
    height, width = pictures[0].shape[:2]
    device = software_device(1)
    sensor = device.add_sensor("RGB Camera")
    size = pictures[0].size // (width * height)
    profile = sensor.add_video_stream(video_stream((width, height), lens, stream_format, size, stream, **options), True)
    with recording(path, device):
        for number, (picture, stamp_s) in enumerate(zip(pictures, stamps_s, strict=True), start=1):
            send(sensor, profile, picture, stamp_s, number)
            time.sleep(pause_s)
    return path


def record_whole(path: Path, pictures: Sequence[np.ndarray], stamps_s: Sequence[float], **options: Any) -> Path:
    """`record_realsense`, again and slower until no picture is missing. Raises CameraError."""
    count = 0
    for pause_s in (0.004, 0.016, 0.064, 0.256):
        path.unlink(missing_ok=True)
        record_realsense(path, pictures, stamps_s, pause_s=pause_s, **options)
        with open_camera(f"realsense:{path}") as camera:
            count = sum(1 for _ in iter(camera.read, None))
        if count == len(pictures):
            return path
    raise CameraError(f"{path}: {count} of {len(pictures)} pictures recorded, however slowly")


def record_motion(path: Path, count: int = 200, period_s: float = 0.005, every: int = 7) -> Path:
    """Write a `.db3`: `count` samples of both, gyro (0.1, 0.2, index / 1000), force (0, -9.8, 1), and a picture for
    every `every`-th of them."""
    device = software_device(2)
    colour, motion = device.add_sensor("RGB Camera"), device.add_sensor("Motion Module")
    video = colour.add_video_stream(video_stream((64, 48), (60.0, 60.0, 32.0, 24.0)), True)
    kinds = {rs.stream.gyro: 2, rs.stream.accel: 3}
    streams = {kind: motion.add_motion_stream(_motion_stream(kind, uid), True) for kind, uid in kinds.items()}
    with recording(path, device):
        for index in range(count):
            stamp_s = 1.0 + period_s * index
            for kind, profile in streams.items():
                vector = rs.vector()
                gyro = kind == rs.stream.gyro
                vector.x, vector.y, vector.z = (0.1, 0.2, index / 1000.0) if gyro else (0.0, -9.8, 1.0)
                profile = profile.as_motion_stream_profile()
                frame = stamped(rs.software_motion_frame(), profile, stamp_s, index + 1)
                frame.data = vector
                motion.on_motion_frame(frame)
            if index % every == 0:
                send(colour, video, np.full((48, 64, 3), index % 255, np.uint8), stamp_s, index // every + 1)
            time.sleep(0.002)
    return path


def _motion_stream(kind: Any, uid: int) -> Any:
    stream = rs.motion_stream()
    stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, 200
    stream.fmt, stream.intrinsics = rs.format.motion_xyz32f, rs.motion_device_intrinsic()
    return stream
