"""Wraps a third-party camera: anything it returns or raises becomes a frame, a fault or the end, never a traceback."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CameraError, CameraFault, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.reading import error_line, one_line, printable
from edgemap.runtime.frames.trajectory import AttitudeTrack, TrackFile, Trajectory
from edgemap.runtime.inputs.cameras.returned import PictureCheck, rate_of, size_of, stamp_of

FALLBACK_STEP_S = 0.1  # between two pictures whose stamps say nothing, of a camera that names no rate
FAILURES = 100  # reads in a row without a frame, after which the camera is at its end

TYPED: dict[str, type] = {
    "intrinsics": Intrinsics, "mount": Mount, "truth": Trajectory, "attitudes": AttitudeTrack, "inference": Inference
}  # fmt: skip


def checked(camera: Camera, name: str) -> Camera:
    """A camera of third-party code is validated; ours is returned as it is."""
    return camera if type(camera).__module__.startswith("edgemap.") else CheckedCamera(camera, name)


class CheckedCamera(Camera):
    """A validated `Camera` of third-party code. Each error is reported once, as a fault, when it begins. A stamp that
    is not finite, or runs backwards, is replaced by the previous one plus a frame interval; invalid pictures and depths
    are dropped. After `FAILURES` reads in a row without a frame the camera is at its end.
    Raises CameraError for a camera without a size or with invalid intrinsics.
    """

    def __init__(self, camera: Camera, name: str) -> None:
        super().__init__(name)
        self._camera = camera
        self.size = size_of(self._get("size"), self.name)
        self.live = self._get("live") is True
        for attribute, kind in TYPED.items():
            setattr(self, attribute, self._typed(attribute, kind))
        self.rate_hz = rate_of(self._get("rate_hz"))
        count = self._get("frame_count")
        self.frame_count = count if isinstance(count, int) and not isinstance(count, bool) and count > 0 else None
        wheel = self._get("wheel")
        self.wheel = wheel if isinstance(wheel, TrackFile) or hasattr(wheel, "stamps_s") else None
        edits = self._get("edits")
        self.edits = edits if isinstance(edits, tuple) and all(isinstance(line, str) for line in edits) else ()
        self._ahead: Frame | None = None
        self._new: list[CameraFault] = []
        self._check = PictureCheck(self.name, self.size, self._new.append)
        self._failures, self._offset_s = 0, 0.0

    @property
    def state(self) -> CameraState:
        """The camera's state, where it is a valid one."""
        try:
            return CameraState(self._camera.state)
        except Exception:  # as in `_read`
            return CameraState.RUNNING

    def read(self) -> Frame | None:
        """The next frame; None at the end. Raises CameraFault once for each error, FrameTimeout while it lasts, and
        CameraError where the camera raises it or has failed for too long.
        """
        if self._new:
            raise self._new.pop(0)
        if self._ahead is not None:
            frame, self._ahead = self._ahead, None
            return frame
        given, frame = self._read(), None
        if given is None:
            return None
        self._check.begin()
        try:
            frame = self._checked(given)
        except Exception as error:  # as in `_read`
            self._check.note(FaultKind.FAILED, f"read raised {error_line(error)}")
        self._failures = 0 if frame is not None else self._failures + 1
        if self._failures > FAILURES:
            raise CameraError(f"camera {self.name}: {FAILURES} reads in a row gave no picture")
        self._ahead = frame
        if self._new or frame is not None:
            return self.read()
        raise FrameTimeout(f"camera {self.name}: no picture", None, self.state)

    def object_records(self) -> list[dict[str, Any]] | None:
        """The true objects, where the camera provides valid records."""
        try:
            records = self._camera.object_records()
        except EdgemapError:
            raise
        except Exception:  # as in `_read`
            return None
        known = isinstance(records, Sequence) and all(isinstance(record, dict) for record in records)
        return list(records) if known and records is not None else None

    def close(self) -> None:
        """Close it; errors of its own code are ignored."""
        try:
            self._camera.close()
        except Exception as error:  # as in `_read`
            self._new.append(CameraFault(FaultKind.FAILED, f"camera {self.name}: does not close: {error_line(error)}"))

    def _read(self) -> Any:
        """What the camera returned, or the error that it raised."""
        try:
            return self._camera.read()
        except EdgemapError:
            raise
        except Exception as error:  # another package's code may raise anything
            return error

    def _checked(self, given: Any) -> Frame | None:
        """A frame made of what was returned; None where it has no picture of this camera. Raises a returned error."""
        if isinstance(given, Exception):
            raise given
        if not isinstance(given, Frame):
            self._check.note(FaultKind.FORMAT, f"read gave a {type(given).__name__}, not a Frame")
            return None
        checked = self._check.picture(given.image, given.depth)
        if checked is None:
            return None
        image, depth = checked
        imu = given.imu if isinstance(given.imu, ImuSamples) else ImuSamples.none()
        if imu is not given.imu or not self._sound(imu):
            self._check.note(FaultKind.FORMAT, "inertial samples are none, or not finite in order of time; left out")
            imu = ImuSamples.none()
        stamp_s = self._stamp(given.stamp_s)
        if self._offset_s:
            imu = replace(imu, stamps_s=imu.stamps_s + self._offset_s)  # the camera's clock is also theirs
        name = printable(given.name) if isinstance(given.name, str) else f"{self.name}#{self._delivered}"
        frame = Frame(self._delivered, stamp_s, image, name, imu, depth, search=given.search is not False)
        self._delivered += 1
        return frame

    def _stamp(self, given: Any) -> float:
        step_s = 1.0 / self.rate_hz if self.rate_hz else FALLBACK_STEP_S
        stamp_s = stamp_of(given)
        next_s = self._last_s + step_s if math.isfinite(self._last_s) else 0.0
        if math.isnan(stamp_s):
            self._check.note(FaultKind.STAMP, f"stamp {one_line(repr(given), 40)} is no time; one frame interval taken")
            stamp_s = next_s
        elif stamp_s + self._offset_s <= self._last_s:
            text = f"stamp {stamp_s:.6g} s is not after {self._last_s - self._offset_s:.6g} s; one interval taken"
            self._check.note(FaultKind.CLOCK, text)
            self._offset_s = next_s - stamp_s
            stamp_s = next_s
        else:
            stamp_s += self._offset_s
        self._last_s = stamp_s
        return stamp_s

    def _sound(self, imu: ImuSamples) -> bool:
        arrays = (imu.stamps_s, imu.gyro_rad_s, imu.accel_m_s2)
        return all(np.isfinite(values).all() for values in arrays) and bool((np.diff(imu.stamps_s) > 0.0).all())

    def _get(self, attribute: str) -> Any:
        try:
            return getattr(self._camera, attribute, None)
        except Exception as error:  # as in `_read`
            raise CameraError(f"camera {self.name}: its {attribute} raises {error_line(error)}") from None

    def _typed(self, attribute: str, kind: type) -> Any:
        value = self._get(attribute)
        if value is not None and not isinstance(value, kind):
            raise CameraError(f"camera {self.name}: its {attribute} is a {type(value).__name__}, no {kind.__name__}")
        return value
