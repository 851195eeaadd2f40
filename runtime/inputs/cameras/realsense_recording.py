"""A recording made by librealsense as a camera."""

from pathlib import Path
from typing import Any

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraInfo, CameraOptions
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import library_path, one_line
from edgemap.runtime.inputs.cameras.realsense import import_realsense, lens_of, picture_size
from edgemap.runtime.inputs.cameras.realsense_frames import (
    as_fast_as_read,
    depth_beside,
    frame_sets,
    recorded_motion,
    started,
    stop,
    to_bgr,
)


class RealSenseRecording(Camera):
    """A `.db3` or `.bag` recorded by librealsense: every colour frame, in order, as fast as it is read. Its depth is
    aligned by librealsense in a separate playback, so that colour is the same with and without.
    """

    def __init__(self, path: Path, name: str, how: CameraOptions) -> None:
        super().__init__(CameraInfo(name, intrinsics=how.intrinsics, mount=how.mount))
        if not path.is_file():
            raise CameraError(f"{path}: no such file")
        self._rs = rs = import_realsense()
        self._path = path
        self._depth = None
        self._pipeline = rs.pipeline()
        self._running = False
        config = rs.config()
        try:
            config.enable_device_from_file(library_path(path), repeat_playback=False)
            config.enable_stream(rs.stream.color)
            self._playback = as_fast_as_read(rs, self._pipeline, config)
            profile = started(rs, self._pipeline, config).get_stream(rs.stream.color)
            self._sets = frame_sets(rs, self._pipeline, self._playback, path)
            self._running = True
        except RuntimeError as error:
            self.close()
            raise CameraError(
                f"{path}: not a RealSense recording with a colour stream ({' '.join(str(error).split())})"
            ) from None
        try:
            self.update_info(
                intrinsics=how.intrinsics or lens_of(profile, str(path)),
                size=picture_size(profile),
                rate_hz=float(profile.fps()),
                imu=recorded_motion(rs, path),
            )
            self._depth = depth_beside(rs, path) if how.depth else None
        except EdgemapError:
            self.close()
            raise
        except RuntimeError as error:
            self.close()
            raise CameraError(f"{path}: motion or depth in it is damaged ({one_line(error)})") from None

    def read(self) -> Frame | None:
        """The next frame; None at the end. Raises CameraError where the recording is damaged or falls silent."""
        if not self._running:
            return None
        colour = next((colour for frames in self._sets if (colour := frames.get_color_frame())), None)
        return None if colour is None else self._frame(colour)

    def close(self) -> None:
        """Stop playback."""
        if self._depth is not None:
            self._depth.close()
        if self._running:
            self._running = False
            stop(self._pipeline)

    def _frame(self, colour: Any) -> Frame:
        stamp_s = colour.get_timestamp() / 1000.0
        if stamp_s <= self._last_s:
            raise CameraFault(
                FaultKind.CLOCK, f"{self._path}: a frame at {stamp_s:.4f} s does not come after {self._last_s:.4f} s"
            )
        image = to_bgr(self._rs, colour, str(self._path))
        depth = None if self._depth is None else self._depth.at(stamp_s)
        return self.frame(image, stamp_s, f"{self._path}#{self._delivered}", depth)
