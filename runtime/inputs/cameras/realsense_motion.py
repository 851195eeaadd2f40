"""Gyro and accelerometer of a RealSense (D435i, D455 and others): live beside the pictures, or out of a recording."""

import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.library_names import library_path
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.cameras.realsense_frames import await_begin, caught_up

PLAYBACK_LIMIT_S = 120.0  # for reading all samples of a recording


def motion_callback(rs: ModuleType, buffer: ImuBuffer) -> Callable[[Any], None]:
    """A librealsense callback that puts motion frames into a buffer, from any thread."""

    def take_in(frame: Any) -> None:
        if frame.is_motion_frame():
            value = frame.as_motion_frame().get_motion_data()
            gyro = frame.get_profile().stream_type() == rs.stream.gyro
            push = buffer.push_rate if gyro else buffer.push_force
            push(frame.get_timestamp() / 1000.0, (value.x, value.y, value.z))

    return take_in


def rotation_from_imu(motion_profile: Any, colour_profile: Any) -> Array:
    """Takes IMU directions into the colour camera's optical frame, by librealsense's extrinsics (column-major there);
    identity where it has none, as in recordings: the axes of these cameras' IMUs are optical ones."""
    try:
        rotation = np.array(motion_profile.get_extrinsics_to(colour_profile).rotation).reshape(3, 3).T
    except RuntimeError:
        return np.eye(3)
    return rotation if abs(np.linalg.det(rotation) - 1.0) < 1e-3 else np.eye(3)


def start_motion(rs: ModuleType, context: Any, serial: str, colour_profile: Any, buffer: ImuBuffer) -> Any:
    """A second pipeline that fills the buffer from the device's gyro and accelerometer; None where it has none."""
    pipeline, config = rs.pipeline(context), rs.config()
    config.enable_device(serial)
    config.enable_stream(rs.stream.gyro)
    config.enable_stream(rs.stream.accel)
    try:
        profile = config.resolve(rs.pipeline_wrapper(pipeline)).get_stream(rs.stream.gyro)
        buffer.rotation = rotation_from_imu(profile, colour_profile)
        pipeline.start(config, motion_callback(rs, buffer))
    except RuntimeError:
        return None
    return pipeline


def recorded_motion(rs: ModuleType, path: Path) -> ImuSamples | None:
    """All inertial samples of a recording; None where it has no gyro and accelerometer.

    They are read through the playback's own sensor: waiting for frame sets gives one sample a picture only.
    Its status is polled: a callback would be Python on the thread that is joined at the end.
    """
    context = rs.context()
    device = context.load_device(library_path(path))
    playback = device.as_playback()
    playback.set_real_time(False)
    kinds = (rs.stream.gyro, rs.stream.accel)
    sensors = [
        (sensor, profiles)
        for sensor in device.query_sensors()
        if (profiles := [found for found in sensor.get_stream_profiles() if found.stream_type() in kinds])
    ]
    if {found.stream_type() for _, profiles in sensors for found in profiles} != set(kinds):
        return None
    buffer, until_s = ImuBuffer(kept=None), time.monotonic() + PLAYBACK_LIMIT_S
    for sensor, profiles in sensors:
        sensor.open(profiles)
    for sensor, _ in sensors:
        sensor.start(motion_callback(rs, buffer))
    await_begin(rs, playback)
    while playback.current_status() != rs.playback_status.stopped and time.monotonic() < until_s:
        time.sleep(0.005)
    for sensor, _ in sensors:
        sensor.stop()
        sensor.close()
    caught_up(playback)
    samples = buffer.take(np.inf)
    return samples if len(samples) else None
