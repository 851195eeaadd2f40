"""Records pictures, gyro and accelerometer as a RealSense with an IMU would: software device and recorder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2

rs: Any = pyrealsense2


def record_motion(path: Path, count: int = 200, period_s: float = 0.005, every: int = 7) -> Path:
    """Write a `.db3`: `count` samples of both, gyro (0.1, 0.2, index / 1000), force (0, -9.8, 1), and a picture for
    every `every`-th of them."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software RealSense")
    device.register_info(rs.camera_info.serial_number, "000000000002")
    colour, motion = device.add_sensor("RGB Camera"), device.add_sensor("Motion Module")
    video = colour.add_video_stream(_video_stream(), True)
    streams = {
        kind: motion.add_motion_stream(_motion_stream(kind, uid), True)
        for uid, kind in ((2, rs.stream.gyro), (3, rs.stream.accel))
    }
    recorder = rs.recorder(str(path), device)
    sensors = recorder.query_sensors()
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(lambda frame: None)
    for index in range(count):
        stamp_ms = 1000.0 + 1000.0 * period_s * index
        for kind, profile in streams.items():
            values = (0.1, 0.2, index / 1000.0) if kind == rs.stream.gyro else (0.0, -9.8, 1.0)
            frame = rs.software_motion_frame()
            _stamp(frame, stamp_ms, index)
            frame.profile = profile.as_motion_stream_profile()
            vector = rs.vector()
            vector.x, vector.y, vector.z = values
            frame.data = vector
            motion.on_motion_frame(frame)
        if index % every == 0:
            frame = rs.software_video_frame()
            _stamp(frame, stamp_ms, index // every)
            frame.stride, frame.bpp, frame.profile = 192, 3, video.as_video_stream_profile()
            frame.pixels = np.full((48, 64, 3), index % 255, np.uint8)
            colour.on_video_frame(frame)
        time.sleep(0.002)  # the recorder writes on a thread of its own
    time.sleep(0.2)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    return path


def _stamp(frame: Any, stamp_ms: float, number: int) -> None:
    frame.timestamp, frame.domain = stamp_ms, rs.timestamp_domain.hardware_clock
    frame.frame_number = number + 1


def _video_stream() -> Any:
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy = 64, 48, 60.0, 60.0
    intrinsics.ppx, intrinsics.ppy, intrinsics.model = 32.0, 24.0, rs.distortion.inverse_brown_conrady
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.color, 0, 1, rs.format.rgb8
    stream.width, stream.height, stream.fps, stream.bpp, stream.intrinsics = 64, 48, 30, 3, intrinsics
    return stream


def _motion_stream(kind: Any, uid: int) -> Any:
    stream = rs.motion_stream()
    stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, 200
    stream.fmt, stream.intrinsics = rs.format.motion_xyz32f, rs.motion_device_intrinsic()
    return stream
