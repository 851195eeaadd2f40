"""A recording made by librealsense as a camera."""

import math
from contextlib import ExitStack, closing
from pathlib import Path

from edgemap.runtime.frames.camera import CameraInfo, CameraOptions, FileCamera, Picture, Pictures
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.cameras.realsense import import_realsense, lens_of, picture_size
from edgemap.runtime.inputs.cameras.realsense_frames import Playback, depth_beside, recorded_motion, to_bgr
from edgemap.runtime.inputs.drives.pictures import DepthBeside


def open_recording(path: Path, name: str, how: CameraOptions) -> FileCamera:
    """A `.db3` or `.bag` recorded by librealsense: every colour frame, in order, as fast as it is read. Its depth is
    aligned by librealsense in a separate playback, so that colour is the same with and without. Raises CameraError.
    """
    if not path.is_file():
        raise CameraError(f"{path}: no such file")
    rs = import_realsense()
    with ExitStack() as resources:
        try:
            playback = resources.enter_context(closing(Playback(rs, path, rs.stream.color)))
        except RuntimeError as error:
            raise CameraError(
                f"{path}: not a RealSense recording with a colour stream ({' '.join(str(error).split())})"
            ) from None
        lens = how.intrinsics or lens_of(playback.profile, str(path))
        try:
            imu, depth = recorded_motion(rs, path), depth_beside(rs, path) if how.depth else None
        except RuntimeError as error:
            raise CameraError(f"{path}: motion or depth in it is damaged ({one_line(error)})") from None
        if depth is not None:
            resources.enter_context(closing(depth))
        size, rate_hz = picture_size(playback.profile), float(playback.profile.fps())
        info = CameraInfo(name, size, lens, how.mount, rate_hz=rate_hz, imu=imu)
        return FileCamera(info, _pictures(playback, depth, path), resources.pop_all().close)


def _pictures(playback: Playback, depth: DepthBeside | None, path: Path) -> Pictures:
    """The colour frames, with a fault for each that does not come after the last."""
    count, last_s = 0, -math.inf
    for frames in playback.frame_sets():
        if not (colour := frames.get_color_frame()):
            continue
        stamp_s = colour.get_timestamp() / 1000.0
        if stamp_s <= last_s:
            text = f"{path}: a frame at {stamp_s:.4f} s does not come after {last_s:.4f} s"
            yield CameraFault(FaultKind.CLOCK, text)
            continue
        image = to_bgr(colour, str(path))
        yield Picture(stamp_s, image, None if depth is None else depth.at(stamp_s), f"{path}#{count}")
        count, last_s = count + 1, stamp_s
