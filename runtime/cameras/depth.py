"""Depth pictures beside a camera's own: of a RealSense, live or recorded, and of a drive with depth/."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.cameras.realsense import (
    POLL_MS,
    SILENT_POLLS,
    RealSenseDriver,
    as_fast_as_read,
    import_realsense,
    is_recording,
    lens_of,
)
from edgemap.runtime.drives.open import READERS, open_drive
from edgemap.runtime.drives.pictures import PICTURE_BYTES, decoded
from edgemap.runtime.errors import CameraError
from edgemap.runtime.reading import read_bytes, user_path

Depth = NDArray[np.float32]


def depth_pictures(spec: str) -> tuple[Intrinsics, Iterator[Depth]] | None:
    """The lens and the depth pictures, (H, W) metres along its optical axis, 0 where unknown; None where SPEC has none.

    A RealSense's depth is aligned to the colour picture by librealsense; a live one delivers until nobody asks.
    Raises CameraError, at once or while reading.
    """
    kind, _, rest = spec.partition(":")
    if kind == "realsense":
        rs = import_realsense()
        config = rs.config()
        if is_recording(rest):
            config.enable_device_from_file(str(user_path(rest)), repeat_playback=False)
        else:
            config = RealSenseDriver(spec, rest or None).config()
        return _realsense(rs, config, spec)
    if kind not in READERS:
        return None
    drive = open_drive(spec)
    return (drive.intrinsics, map(_read, drive.depth)) if drive.depth and drive.intrinsics else None


def _realsense(rs: ModuleType, config: Any, name: str) -> tuple[Intrinsics, Iterator[Depth]] | None:
    for stream in (rs.stream.color, rs.stream.depth):
        config.enable_stream(stream)
    pipeline = rs.pipeline()
    try:
        playback = as_fast_as_read(rs, pipeline, config)
        active = pipeline.start(config)
    except RuntimeError:  # no depth stream; the camera itself says what else is wrong
        return None
    lens = lens_of(active.get_stream(rs.stream.color), name)
    return lens, _aligned(rs, pipeline, playback, name)


def _aligned(rs: ModuleType, pipeline: Any, playback: Any, name: str) -> Iterator[Depth]:
    align, last, silent = rs.align(rs.stream.color), -1, 0
    try:
        while silent < SILENT_POLLS:
            stopped = bool(playback) and playback.current_status() == rs.playback_status.stopped
            there, frames = pipeline.try_wait_for_frames(POLL_MS)
            if stopped and not there:
                return
            silent = 0 if there else silent + 1
            measured = frames.get_depth_frame() if there else None
            if not measured or not frames.get_color_frame() or measured.get_frame_number() == last:
                continue
            last = measured.get_frame_number()
            aligned = align.process(frames).get_depth_frame()
            yield np.asanyarray(aligned.get_data()).astype(np.float32) * np.float32(aligned.get_units())
    finally:
        pipeline.stop()
    raise CameraError(f"{name}: no depth picture for {SILENT_POLLS * POLL_MS / 1000:.0f} s")


def _read(path: Path) -> Depth:
    """A 16-bit picture of millimetres. Raises CameraError."""
    image = decoded(read_bytes(path, PICTURE_BYTES, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise CameraError(f"{path}: not a depth picture (one channel of 16 bits, millimetres)")
    return image.astype(np.float32) / np.float32(1000.0)
