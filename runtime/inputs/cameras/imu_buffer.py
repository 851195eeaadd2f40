"""Buffers IMU samples from a driver's thread or a program, and delivers them with the frames."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import QUEUE
from edgemap.runtime.inputs.cameras.delivery import clock_jumps
from edgemap.runtime.inputs.cameras.wrappers import CameraAround

OVERLAP_S = 0.1  # forces of this time are kept for interpolation

_Row = tuple[float, float, float, float]


class ImuBuffer:
    """Buffer of samples in the axes of the IMU, stamped with the clock of the frames. It is thread-safe.

    rotation: (3, 3), from the IMU frame to the camera's optical frame. kept: maximum number of samples of each kind;
    None for no limit. clock_s: host clock, s, for samples that are pushed when they are measured. If the device clock
    jumps or restarts, the stamps continue with the host clock, as those of the pictures do (`StreamClock`).
    """

    def __init__(
        self,
        rotation: NDArray[np.float64] | None = None,
        kept: int | None = QUEUE,
        clock_s: Callable[[], float] | None = None,
    ) -> None:
        self.rotation = np.eye(3) if rotation is None else rotation
        self._kept, self._clock_s = kept, clock_s
        self._newest: tuple[float, float] | None = None  # the device's stamp and the host's seconds
        self._offset_s = 0.0
        self.dropped: list[str] = []  # why samples were left out
        self._lock = threading.Lock()
        self._rates: list[_Row] = []
        self._forces: list[_Row] = []

    def push(self, stamp_s: float, gyro_rad_s: Sequence[float], accel_m_s2: Sequence[float]) -> None:
        """Adds one sample of angular rate, rad/s, and specific force, m/s^2 (upwards at rest)."""
        self.push_force(stamp_s, accel_m_s2)
        self.push_rate(stamp_s, gyro_rad_s)

    def push_rate(self, stamp_s: float, gyro_rad_s: Sequence[float]) -> None:
        """Adds one sample of the gyro only, rad/s."""
        self._append(self._rates, stamp_s, gyro_rad_s)

    def push_force(self, stamp_s: float, accel_m_s2: Sequence[float]) -> None:
        """Adds one sample of the accelerometer only, m/s^2. The force is interpolated between such samples."""
        self._append(self._forces, stamp_s, accel_m_s2)

    def take(self, until_s: float) -> ImuSamples:
        """Removes and returns all samples up to a stamp, at the stamps of the gyro. Later samples stay."""
        with self._lock:
            rates = [row for row in self._rates if row[0] <= until_s]
            forces = list(self._forces)
            self._rates[:] = [row for row in self._rates if row[0] > until_s]
            self._forces[:] = [row for row in self._forces if row[0] > until_s - OVERLAP_S]
        if not rates or not forces:
            return ImuSamples.none()
        gyro, accel = (np.array(sorted(rows)) for rows in (rates, forces))
        gyro = gyro[np.concatenate([[True], np.diff(gyro[:, 0]) > 0.0])]
        force = np.column_stack([np.interp(gyro[:, 0], accel[:, 0], accel[:, axis]) for axis in (1, 2, 3)])
        return ImuSamples(gyro[:, 0].copy(), gyro[:, 1:].copy(), force).rotated(self.rotation)

    def _append(self, rows: list[_Row], stamp_s: float, values: Sequence[float]) -> None:
        x, y, z = (float(value) for value in values)
        if not np.isfinite([stamp_s, x, y, z]).all():
            if self._kept is None:
                self.dropped.append(f"at {stamp_s:.3f} s: {x:g}, {y:g}, {z:g}")
            return
        with self._lock:
            rows.append((float(stamp_s) + self._shift_s(float(stamp_s)), x, y, z))
            if self._kept is not None:
                del rows[: -self._kept]

    def _shift_s(self, stamp_s: float) -> float:
        """Offset from the device clock to the stream clock, s."""
        if self._clock_s is None:
            return 0.0
        now_s = self._clock_s()
        if self._newest is not None:
            step_s, passed_s = stamp_s - self._newest[0], now_s - self._newest[1]
            if clock_jumps(step_s, passed_s):
                self._offset_s += passed_s - step_s
        self._newest = stamp_s, now_s
        return self._offset_s


class ImuCamera(CameraAround):
    """A camera whose frames include the samples of an IMU buffer."""

    def __init__(self, camera: Camera, buffer: ImuBuffer) -> None:
        super().__init__(camera)
        self._buffer = buffer

    def read(self) -> Frame | None:
        """The next frame of the wrapped camera, with the samples up to its stamp."""
        frame = super().read()
        return None if frame is None else replace(frame, imu=self._buffer.take(frame.stamp_s))
