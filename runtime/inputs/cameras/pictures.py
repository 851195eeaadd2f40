"""Pictures, a video or a recorded drive as a camera: every frame, in order."""

import math
import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import DEFAULT_RATE_HZ, CameraInfo, FileCamera, Picture, Pictures
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.reading import library_path, one_line
from edgemap.runtime.inputs.cameras.checked import rate_of
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.pictures import (
    PIXEL_LIMIT,
    Depth,
    Levels,
    read_picture,
    readable_depth,
    video_frames,
)


def drive_camera(drive: Drive, name: str) -> FileCamera:
    """The drive's frames at the drive's stamps. Raises CameraError where none can be read."""
    info = CameraInfo(
        name,
        intrinsics=drive.intrinsics,
        mount=drive.mount,
        rate_hz=drive.rate_hz,
        truth=drive.truth,
        attitudes=drive.attitudes,
        wheel=drive.wheel,
        imu=drive.imu,
    )
    return _pictures(drive, info) if drive.video is None else _video(drive, drive.video, info)


def _depth_of(drive: Drive, index: int) -> Callable[[Intrinsics | None], Depth | str | None] | None:
    """What gives the depth of a picture's pixels by its lens, or why it cannot be used; nothing where the lens is
    unknown. None without depth."""
    if not drive.depth:
        return None
    path, camera = drive.depth[index], drive.depth_camera

    def registered(lens: Intrinsics | None) -> Depth | str | None:
        depth = readable_depth(path)
        if isinstance(depth, str) or camera is None:
            return depth
        if lens is None:
            return None
        if (moved := camera.registered(depth, lens)) is None:
            return f"{depth.shape[1]}x{depth.shape[0]} px, its camera has another size"
        return moved

    return registered


def _video(drive: Drive, path: Path, info: CameraInfo) -> FileCamera:
    """A video that OpenCV decodes. Memory is bounded, independent of the size that the file claims. Raises CameraError
    for no video, and for one of too many pixels."""
    if _is_text(path):  # a list of other files, which FFmpeg would play
        raise CameraError(f"{path}: a text, not a video")
    # Without a named backend OpenCV also takes the path for a picture pattern.
    known = cv2.videoio_registry.getBackends()
    capture = cv2.VideoCapture(library_path(path), cv2.CAP_FFMPEG if cv2.CAP_FFMPEG in known else cv2.CAP_ANY)
    if not capture.isOpened():
        raise CameraError(
            f"{path}: not a video that OpenCV reads ({path.stat().st_size} bytes): cut off, or another format"
        )
    wide, high = (int(capture.get(what)) for what in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if wide * high > PIXEL_LIMIT:
        raise CameraError(f"{path}: video of {wide}x{high} px, at most {PIXEL_LIMIT:,} px are decoded")
    rate_hz, announced = rate_of(capture.get(cv2.CAP_PROP_FPS)), int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    fourcc = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    frames = video_frames(capture)
    first = next(frames, None)  # what the header says of the size may be turned by the rotation tag
    if first is None:
        codec = one_line(fourcc.to_bytes(4, "little").decode("ascii", "replace")) or "unknown"
        again = shlex.join(["ffmpeg", "-i", str(path), "-c:v", "libx264", f"{path.with_suffix('')}-h264.mp4"])
        raise CameraError(
            f"{path}: a video in which no frame can be decoded (codec {codec}, {announced} announced frames): "
            f"where it plays elsewhere, OpenCV lacks the codec: {again}"
        )
    count = announced if 0 < announced < 1 << 31 else None
    pictures = _of_video(drive, path, chain([first], frames), rate_hz or DEFAULT_RATE_HZ, count)
    height, width = first[0].shape[:2]
    info = replace(
        info, size=(width, height), rate_hz=info.rate_hz or rate_hz, frame_count=len(drive.stamps_s) or count
    )
    return FileCamera(info, pictures, capture.release)


def _of_video(
    drive: Drive, path: Path, frames: Iterator[tuple[NDArray[np.uint8], float]], rate_hz: float, announced: int | None
) -> Pictures:
    """Pictures of a video at the drive's stamps, of which there must be one for each. Without any, at the file's, or
    last + 1 / rate where those do not increase. Raises CameraError, after the last good one, where the file is cut off.

    frames: with the file's stamps. announced: their number by its header, None where it states none.
    """
    stamps_s = drive.stamps_s.tolist()
    count, first_s, last_s = 0, 0.0, -math.inf
    for image, file_stamp_s in frames:
        if stamps_s:
            if count >= len(stamps_s):
                raise CameraError(f"{path}: more frames than the {len(stamps_s)} poses beside it")
            last_s = stamps_s[count]
        elif math.isfinite(file_stamp_s) and file_stamp_s > last_s:
            last_s = file_stamp_s
        else:
            last_s = last_s + 1.0 / rate_hz if count else 0.0
        first_s = first_s if count else last_s
        yield Picture(last_s, image, _depth_of(drive, count), f"{path}#{count}")
        count += 1
    if count < len(stamps_s):
        raise CameraError(f"{path}: ends after {count} frames, {len(stamps_s)} poses beside it")
    if announced is None:
        return
    # A header's frame count is an estimate in some containers; a file that lacks more than this was cut off.
    allowed = max(3, 0.05 * announced)
    # Containers without a count announce their length times the rate: of a variable rate only the length holds.
    until = 1 + round((last_s - first_s) * rate_hz)
    if announced - max(count, until) > allowed:
        raise CameraError(f"{path}: cut off, {count} of {announced} announced frames decoded")


def _is_text(path: Path) -> bool:
    """Whether a file begins as texts do, without control characters; of videos only AVI and YUV4MPEG2 may."""
    with path.open("rb") as file:
        begin = file.read(8)
    text = not any(byte < 9 or 13 < byte < 32 for byte in begin)
    return begin != b"" and text and not begin.startswith((b"RIFF", b"YUV4MPEG"))


def _pictures(drive: Drive, info: CameraInfo) -> FileCamera:
    """Picture files. Raises the first one's CameraError where none can be read."""
    levels, failures = Levels(), list[CameraError]()
    for path in drive.images:
        try:
            height, width = read_picture(path, levels).shape[:2]
        except CameraError as error:
            failures.append(error)
            continue
        size, rate_hz = (width, height), info.rate_hz or DEFAULT_RATE_HZ
        info = replace(info, size=size, rate_hz=rate_hz, frame_count=len(drive.images), notes=levels.notes)
        return FileCamera(info, _of_pictures(drive, size, levels))
    raise failures[0]


def _of_pictures(drive: Drive, size: tuple[int, int], levels: Levels) -> Pictures:
    """The drive's pictures, with a fault for each that is damaged or not of the size, (width, height)."""
    for index, (path, stamp_s) in enumerate(zip(drive.images, drive.stamps_s.tolist(), strict=False)):
        try:
            image = read_picture(path, levels)
        except CameraError as error:
            yield CameraFault(FaultKind.DAMAGED, f"{error}, skipped")
            continue
        height, width = image.shape[:2]
        if (width, height) == size:
            yield Picture(stamp_s, image, _depth_of(drive, index), str(path))
        else:
            text = f"{path}: picture is {width}x{height}, the others are {size[0]}x{size[1]}, skipped"
            yield CameraFault(FaultKind.SIZE, text)
