"""Records pictures, gyro and accelerometer as a RealSense with an IMU would."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from reliability.record_realsense import recording, rs, send, software_device, stamped, video_stream


def record_motion(path: Path, count: int = 200, period_s: float = 0.005, every: int = 7) -> Path:
    """Write a `.db3`: `count` samples of both, gyro (0.1, 0.2, index / 1000), force (0, -9.8, 1), and a picture for
    every `every`-th of them."""
    device = software_device(2)
    colour, motion = device.add_sensor("RGB Camera"), device.add_sensor("Motion Module")
    video = colour.add_video_stream(video_stream((64, 48), (60.0, 60.0, 32.0, 24.0)), True)
    streams = {
        kind: motion.add_motion_stream(_motion_stream(kind, uid), True)
        for uid, kind in ((2, rs.stream.gyro), (3, rs.stream.accel))
    }
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
