"""Frames and motion samples of librealsense's pipelines: colour as BGR with depth, gyro and accelerometer."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import FaultKind, note
from edgemap.runtime.frames.limits import PATIENCE_S, SILENCE_S, TICK_S
from edgemap.runtime.frames.reading import library_path
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.drives.pictures import APART_S, ENCODINGS, Depth, DepthBeside, bgr_of

POLL_MS = round(1e3 * TICK_S)  # of one wait for a frame


def aligned_depth(align: Any, frames: Any) -> Depth | None:
    """Depth of a set of frames at the pixels of its colour frame, (H, W) metres, 0 where unknown; None where the set
    has no depth, or one of another time. align: librealsense's, to colour."""
    depth, colour = frames.get_depth_frame(), frames.get_color_frame()
    if not depth or not colour or abs(depth.get_timestamp() - colour.get_timestamp()) > 1000.0 * APART_S:
        return None
    aligned = align.process(frames).get_depth_frame()
    return np.asanyarray(aligned.get_data()).astype(np.float32) / np.float32(round(1.0 / aligned.get_units()))


class Playback:
    """Streams of a recording, as fast as they are read. Raises librealsense's RuntimeError where it lacks one.

    profile: of the first stream.
    """

    def __init__(self, rs: ModuleType, path: Path, *streams: Any) -> None:
        self._rs, self._path, self._pipeline, config = rs, path, rs.pipeline(), rs.config()
        config.enable_device_from_file(library_path(path), repeat_playback=False)
        for stream in streams:
            config.enable_stream(stream)
        # Before the start: in real time, playback drops the pictures that come before the pipeline waits for them.
        self._playback = config.resolve(rs.pipeline_wrapper(self._pipeline)).get_device().as_playback()
        self._playback.set_real_time(False)
        self.profile = started(rs, self._pipeline, config).get_stream(streams[0])

    def frame_sets(self) -> Iterator[Any]:
        """Sets of frames until it ends. Raises CameraError where it falls silent before."""
        heard_s = time.monotonic()
        while time.monotonic() - heard_s < SILENCE_S:
            # Asked first: what was queued when playback stopped is still there to be waited for.
            stopped = self._playback.current_status() == self._rs.playback_status.stopped
            there, frames = self._pipeline.try_wait_for_frames(POLL_MS)
            if there:
                yield frames
                heard_s = time.monotonic()
            elif stopped:
                return
        raise CameraError(f"{self._path}: no frame for {SILENCE_S:.0f} s and no end either")

    def close(self) -> None:
        """Stop it, with the thread that reads the file."""
        stop(self._pipeline)


def depth_beside(rs: ModuleType, path: Path) -> DepthBeside | None:
    """The depth of a recording; None where it has none."""
    try:
        playback = Playback(rs, path, rs.stream.color, rs.stream.depth)
    except RuntimeError:  # no depth stream; the camera itself says what else is wrong
        return None
    return DepthBeside(_aligned_pictures(rs, playback), APART_S)


def _aligned_pictures(rs: ModuleType, playback: Playback) -> Generator[tuple[float, Callable[[], Depth]], None, None]:
    """Stamps and depth pictures of a playback until it ends or is silent; then it is stopped."""
    align, last = rs.align(rs.stream.color), -1
    # Silence is a CameraError, which the camera itself reports.
    with closing(playback), suppress(CameraError):
        for frames in playback.frame_sets():
            measured = frames.get_depth_frame()
            if not measured or measured.get_frame_number() == last:
                continue
            depth = aligned_depth(align, frames)
            if depth is not None:
                last = measured.get_frame_number()
                yield measured.get_timestamp() / 1000.0, lambda depth=depth: depth


def started(rs: ModuleType, pipeline: Any, config: Any) -> Any:
    """The profile of a pipeline that was started; for a recording, its status from now on shows when it has ended."""
    profile = pipeline.start(config)
    if playback := profile.get_device().as_playback():
        await_begin(rs, playback)
    return profile


def await_begin(rs: ModuleType, playback: Any) -> None:
    """Waits until the thread reading a recording has started. Before that its status equals that of an ended one, and
    the start would follow a stop. For a recording that ended before this call it waits `PATIENCE_S`.
    """
    until_s = time.monotonic() + PATIENCE_S
    while playback.current_status() == rs.playback_status.stopped and time.monotonic() < until_s:
        time.sleep(0.001)


def stop(pipeline: Any) -> None:
    """Stop a pipeline, and where it plays a recording also the thread that reads the file."""
    playback = pipeline.get_active_profile().get_device().as_playback()
    pipeline.stop()
    if playback:
        caught_up(playback)


def caught_up(playback: Any) -> None:
    """Waits until the thread that reads a recording has processed all requests.

    Releasing a playback before that aborts the process: librealsense's thread uses the destroyed device (2.59:
    `stop_internal` after `~playback_device`). Resuming a playback that is not paused only waits for the thread; called
    twice, since a read may be queued behind the first.
    """
    playback.resume()
    playback.resume()


def to_bgr(frame: Any, name: str) -> NDArray[np.uint8]:
    """The frame's picture as BGR, (H, W, 3) uint8, a copy. Raises CameraError for an unknown format."""
    pixel_format = frame.get_profile().format().name
    data = np.frombuffer(memoryview(np.asanyarray(frame.get_data())).cast("B"), np.uint8)
    if pixel_format == "mjpeg":
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if image is None:
            raise CameraError(f"{name}: a damaged MJPEG frame of {data.size} bytes")
        return np.asarray(image, dtype=np.uint8)
    encoding = "mono8" if pixel_format == "y8" else pixel_format
    if encoding not in ENCODINGS:
        raise CameraError(f"{name}: colour format {pixel_format} is not supported")
    return bgr_of(data.reshape(frame.get_height(), -1), encoding)


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

    They are read through the playback's sensor: waiting for frame sets gives one sample a picture only. Its status is
    polled: a callback would be Python on the thread that is joined at the end.
    """
    context = rs.context()
    device = context.load_device(library_path(path))
    playback = device.as_playback()
    playback.set_real_time(False)
    kinds = (rs.stream.gyro, rs.stream.accel)
    sensors = [
        (sensor, profiles)
        for sensor in device.query_sensors()
        if (profiles := [profile for profile in sensor.get_stream_profiles() if profile.stream_type() in kinds])
    ]
    if {profile.stream_type() for _, profiles in sensors for profile in profiles} != set(kinds):
        return None
    buffer, until_s = ImuBuffer(kept=None), time.monotonic() + PLAYBACK_LIMIT_S
    for sensor, profiles in sensors:
        sensor.open(profiles)
    for sensor, _ in sensors:
        sensor.start(motion_callback(rs, buffer))
    await_begin(rs, playback)
    while playback.current_status() != rs.playback_status.stopped and time.monotonic() < until_s:
        time.sleep(0.005)
    if playback.current_status() != rs.playback_status.stopped:
        text = f"{path}: its motion is not read whole within {PLAYBACK_LIMIT_S:g} s, the rest is left out"
        note(FaultKind.SAMPLES, text)
    for sensor, _ in sensors:
        sensor.stop()
        sensor.close()
    caught_up(playback)
    samples = buffer.take(np.inf)
    return samples if len(samples) else None
