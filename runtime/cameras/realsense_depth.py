"""Depth of a RealSense beside its colour pictures, aligned to them by librealsense."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from edgemap.runtime.cameras.realsense_playback import POLL_MS, SILENT_POLLS, as_fast_as_read, started, stop
from edgemap.runtime.drives.depth import Depth

LATE_S = 0.02  # between a picture and the depth that belongs to it


class Aligned:
    """Depth of a set of librealsense's frames, at the pixels of its colour frame."""

    def __init__(self, rs: ModuleType) -> None:
        self._align = rs.align(rs.stream.color)

    def __call__(self, frames: Any) -> Depth | None:
        """(H, W) metres, 0 where unknown; None where the set has no depth, or one of another time."""
        depth, colour = frames.get_depth_frame(), frames.get_color_frame()
        if not depth or not colour or abs(depth.get_timestamp() - colour.get_timestamp()) > 1000.0 * LATE_S:
            return None
        aligned = self._align.process(frames).get_depth_frame()
        return np.asanyarray(aligned.get_data()).astype(np.float32) / np.float32(round(1.0 / aligned.get_units()))


class DepthBeside:
    """Depth pictures of a recording, asked for by stamps that increase."""

    def __init__(self, pictures: Iterator[tuple[float, Depth]]) -> None:
        self._pictures = pictures
        self._ahead = next(pictures, None)

    def at(self, stamp_s: float) -> Depth | None:
        """The one of this stamp; None where there is none."""
        while self._ahead is not None and self._ahead[0] < stamp_s - LATE_S:
            self._ahead = next(self._pictures, None)
        if self._ahead is None or self._ahead[0] > stamp_s + LATE_S:
            return None
        return self._ahead[1]

    def close(self) -> None:
        """Stop the playback."""
        self._pictures.close()  # type: ignore[attr-defined]
        self._ahead = None


def depth_beside(rs: ModuleType, path: Path) -> DepthBeside | None:
    """The depth of a recording; None where it has none."""
    config = rs.config()
    config.enable_device_from_file(str(path), repeat_playback=False)
    playing = start_aligned(rs, config)
    return None if playing is None else DepthBeside(aligned_pictures(rs, *playing))


def start_aligned(rs: ModuleType, config: Any) -> tuple[Any, Any] | None:
    """A pipeline of colour and depth, and its playback (False of a device); None where there is no depth stream."""
    for stream in (rs.stream.color, rs.stream.depth):
        config.enable_stream(stream)
    pipeline = rs.pipeline()
    try:
        playback = as_fast_as_read(rs, pipeline, config)
        started(rs, pipeline, config)
    except RuntimeError:  # no depth stream; the camera itself says what else is wrong
        return None
    return pipeline, playback


def aligned_pictures(rs: ModuleType, pipeline: Any, playback: Any) -> Iterator[tuple[float, Depth]]:
    """Stamps and depth pictures of a running pipeline until it ends or is silent; then it is stopped."""
    align, last, silent = Aligned(rs), -1, 0
    try:
        while silent < SILENT_POLLS:
            stopped = bool(playback) and playback.current_status() == rs.playback_status.stopped
            there, frames = pipeline.try_wait_for_frames(POLL_MS)
            if stopped and not there:
                return
            silent = 0 if there else silent + 1
            measured = frames.get_depth_frame() if there else None
            if not measured or measured.get_frame_number() == last:
                continue
            depth = align(frames)
            if depth is not None:
                last = measured.get_frame_number()
                yield measured.get_timestamp() / 1000.0, depth
    finally:
        stop(pipeline)
