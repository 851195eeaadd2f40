"""Depth pictures beside a camera's own: of a RealSense, live or recorded, and of a drive with depth/."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any

from edgemap.geometry.camera.depth_camera import DepthRegistration
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import library_path, user_path
from edgemap.runtime.inputs.cameras.realsense import RealSenseDriver, import_realsense, is_recording, lens_of
from edgemap.runtime.inputs.cameras.realsense_frames import POLL_MS, SILENT_POLLS, aligned_pictures, start_aligned, stop
from edgemap.runtime.inputs.drives.open import READERS, open_drive
from edgemap.runtime.inputs.drives.pictures import Depth, read_depth


def depth_pictures(spec: str) -> tuple[Intrinsics, Iterator[Depth]] | None:
    """The lens and the depth pictures, (H, W) metres along its optical axis, 0 where unknown; None where SPEC has none.

    A RealSense's depth is aligned to the colour picture by librealsense; a live one stops when it is no longer read.
    Raises CameraError, at once or while reading.
    """
    kind, _, rest = spec.partition(":")
    if kind == "realsense":
        rs = import_realsense()
        config = rs.config()
        if is_recording(rest):
            config.enable_device_from_file(library_path(user_path(rest)), repeat_playback=False)
        else:
            config = RealSenseDriver(spec, rest or None).config()
        return _realsense(rs, config, spec)
    if kind not in READERS:
        return None
    drive = open_drive(spec)
    if not drive.depth or drive.intrinsics is None:
        return None
    depths = map(read_depth, drive.depth)
    if drive.depth_camera is not None:
        registered = map(DepthRegistration(drive.depth_camera, drive.intrinsics).registered, depths)
        depths = (depth for depth in registered if depth is not None)
    return drive.intrinsics, depths


def _realsense(rs: ModuleType, config: Any, name: str) -> tuple[Intrinsics, Iterator[Depth]] | None:
    started = start_aligned(rs, config)
    if started is None:
        return None
    try:
        lens = lens_of(started[0].get_active_profile().get_stream(rs.stream.color), name)
    except CameraError:
        stop(started[0])
        raise
    return lens, _depths(rs, *started, name)


def _depths(rs: ModuleType, pipeline: Any, playback: Any, name: str) -> Iterator[Depth]:
    for _, depth in aligned_pictures(rs, pipeline, playback):
        yield depth
    if not playback:
        raise CameraError(f"{name}: no depth picture for {SILENT_POLLS * POLL_MS / 1000:.0f} s")
