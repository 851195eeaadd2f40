"""Records pictures as a RealSense would, through librealsense's own software device and recorder: no camera needed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.open import open_camera

rs: Any = pyrealsense2  # its type stubs lack most of it

FX, FY, CX, CY = 615.2, 615.4, 321.1, 239.7


def record_realsense(
    path: Path,
    pictures: Sequence[np.ndarray],
    stamps_s: Sequence[float],
    model: Any = rs.distortion.inverse_brown_conrady,
    coefficients: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0),
    stream_format: Any = rs.format.rgb8,
    lens: tuple[float, float, float, float] = (FX, FY, CX, CY),
    fps: int = 30,
    stream: Any = rs.stream.color,
    pause_s: float = 0.004,
) -> Path:
    """Write a `.db3`: pictures in the stream's own format, (H, W, C) uint8, at the stamps in seconds.

    pause_s: between two pictures, in real time: the recorder writes on a thread of its own, and drops what it does not
    come to on a busy machine.
    """
    height, width = pictures[0].shape[:2]
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = width, height
    intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = lens
    intrinsics.model, intrinsics.coeffs = model, list(coefficients)
    bytes_per_pixel = pictures[0].size // (width * height)
    description = rs.video_stream()
    description.type, description.index, description.uid = stream, 0, 1
    description.width, description.height, description.fps = width, height, fps
    description.bpp, description.fmt, description.intrinsics = bytes_per_pixel, stream_format, intrinsics

    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software RealSense")
    device.register_info(rs.camera_info.serial_number, "000000000001")
    sensor = device.add_sensor("RGB Camera")
    profile = sensor.add_video_stream(description, True)
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles()[0])
    queue = rs.frame_queue(len(pictures) + 1)
    recorded.start(queue)
    for number, (picture, stamp) in enumerate(zip(pictures, stamps_s, strict=True), start=1):
        frame = rs.software_video_frame()
        frame.stride, frame.bpp = width * bytes_per_pixel, bytes_per_pixel
        frame.timestamp, frame.domain = stamp * 1000.0, rs.timestamp_domain.hardware_clock
        frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
        frame.pixels = np.ascontiguousarray(picture)
        sensor.on_video_frame(frame)
        time.sleep(pause_s)
    time.sleep(0.2)
    recorded.stop()
    recorded.close()
    del recorder
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
