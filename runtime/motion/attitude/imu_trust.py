"""Whether gyro and accelerometer are used: their clock, full scale, impossible values, too few samples, and yaw."""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.trust import Agreement, Trust, TrustRule

Array = NDArray[np.float64]

# By datasheets: the smallest full scale (125 deg/s, 2 g), from which on a value that repeats bit by bit is saturated,
# and the largest (2000 deg/s, 16 g).
GYRO_RAD_S, ACCEL_M_S2 = (1.5, 35.0), (15.0, 160.0)
REPEATS = 5  # of one value: a driver delivers a sample up to four times; as many of all three axes are a frozen gyro's
LIVELY = 50  # samples after which a sensor counts as one with noise
SINGLE = 10  # samples, each alone in its frame, from which the rate is computed
APART_S = 1.0  # between a frame and its newest sample, from which on they are of two clocks, or of two sides of a hole
HISTORY_S = 100.0  # of samples before a frame that are integrated at most
OTHER_CLOCK = 10  # frames in a row without samples but of another time, from which on it is a fault


class _Sensor:
    """One sensor's samples, judged without the other's. The sensor is bad when half of the samples over a window, or
    all of a frame's, are bad, until less than a tenth of that are."""

    def __init__(self, name: str, unit: str, bounds: tuple[float, float], window_s: float, freezes: bool) -> None:
        self.name, self._unit, self._window_s, self._freezes = name, unit, window_s, freezes
        self._least, self._most = bounds
        self._last, self._runs = np.full(3, math.nan), np.zeros(3, dtype=np.intp)
        self._share, self.bad, self.reason = -1.0, False, ""
        self._lively = 0  # samples of which every axis differed from the one before

    def judge(self, values: Array, span_s: float) -> NDArray[np.bool_]:
        """Which of the samples (N, 3) are plausible, (N,)."""
        good = np.ones(len(values), dtype=bool)
        for row, value in enumerate(values):
            same = value == self._last
            self._runs, self._lively = np.where(same, self._runs + 1, 0), self._lively + (not same.any())
            self._last, size = value, np.abs(value)
            clipped = (self._runs >= REPEATS) & (size >= self._least)
            held = self._freezes and self._lively >= LIVELY and self._runs.min() >= REPEATS
            if clipped.any() or held:
                good[max(row - int(self._runs.min() if held else self._runs[clipped].max()), 0) : row + 1] = False
                self.reason = (
                    f"{self.name} {'saturated' if clipped.any() else 'frozen'} at {size.max():.1f} {self._unit}"
                )
            elif not (size <= self._most).all():
                good[row], self.reason = False, f"{self.name} at {size.max():.1f} {self._unit}: none can be"
        share = 1.0 - float(good.mean())
        taken = 1.0 if self._share < 0.0 else min(span_s / self._window_s, 1.0)
        self._share = max(self._share, 0.0) + taken * (share - max(self._share, 0.0))
        self.bad = max(self._share, share / 2.0) >= (0.05 if self.bad else 0.5)
        return good


class ImuTrust:
    """Selects valid samples, and decides which sensor is excluded."""

    def __init__(self, window_s: float, trust: TrustRule) -> None:
        """window_s: over which samples are judged. trust: how the gyro's yaw is compared with the odometry's."""
        self._gyro = _Sensor("gyro", "rad/s", GYRO_RAD_S, window_s, freezes=True)
        self._accel = _Sensor("accelerometer", "m/s2", ACCEL_M_S2, window_s, freezes=False)
        self._yaw = Agreement(trust, trust.least[0])
        self._turned_rad = self._span_s = 0.0  # over the last step, by the gyro
        self._seen_s, self._reason = math.nan, ""
        self._frames, self._per_sample = 0, deque[int](maxlen=SINGLE)  # since the last sample; of the last samples
        self._slow = False
        self._off_clock = 0  # frames since the newest samples, where these are of another time
        self._off_clock_s = 0.0

    @property
    def proved(self) -> bool:
        """Whether the odometry has confirmed the gyro's yaw and still does."""
        return self._yaw.state is Trust.TRUSTED and not self._yaw.doubted

    @property
    def left_out(self) -> bool:
        """Whether the samples are not to be used."""
        return bool(self._reason)

    def judge(
        self, samples: ImuSamples, stamp_s: float, moved: tuple[SE2, Array] | None, up: Array, bias: Array
    ) -> tuple[ImuSamples, Fault | None]:
        """The valid samples, and a fault where a sensor is excluded from now on, or used again. moved: motion of the
        step before, by the odometry without the gyro. up: (3,), optical frame. bias: (3,), the gyro's estimated bias.
        """
        samples = self._of_frame(samples, stamp_s)
        self._count(len(samples))
        if self._off_clock == OTHER_CLOCK:
            return self._with_fault(samples)
        if not len(samples):
            return samples, None
        span_s = stamp_s - self._seen_s if math.isfinite(self._seen_s) else 0.0
        self._compare(moved)
        good = self._gyro.judge(samples.gyro_rad_s, span_s)
        good &= self._accel.judge(samples.accel_m_s2, span_s)
        self._seen_s, self._span_s = stamp_s, span_s
        self._turned_rad = float((samples.gyro_rad_s.mean(axis=0) - bias) @ up) * span_s
        if not good.all():
            samples = ImuSamples(samples.stamps_s[good], samples.gyro_rad_s[good], samples.accel_m_s2[good])
        return self._with_fault(samples)

    def _of_frame(self, samples: ImuSamples, stamp_s: float) -> ImuSamples:
        """The samples up to the frame; none where the newest is more than APART_S from its stamp."""
        if not len(samples):
            self._off_clock += self._off_clock > 0
            return samples
        self._off_clock_s = stamp_s - float(samples.stamps_s[-1])
        self._off_clock = self._off_clock + 1 if abs(self._off_clock_s) > APART_S else 0
        return ImuSamples.none() if self._off_clock else samples.between(stamp_s - HISTORY_S, stamp_s)

    def _with_fault(self, samples: ImuSamples) -> tuple[ImuSamples, Fault | None]:
        """The samples, and a fault where their exclusion begins or ends."""
        before, self._reason = self._reason, self._guilty()
        if self._reason and not before:
            return samples, Fault(FaultKind.IMU_EXCLUDED, f"{self._reason}: the IMU is left out")
        again = Fault(FaultKind.IMU_RESTORED, "the IMU (gyro and accelerometer) is used again")
        return samples, again if before and not self._reason else None

    def _count(self, samples: int) -> None:
        """Counts the frames per sample while no frame brings two: several at once are a driver's packet, not a low
        rate."""
        self._frames += 1
        if samples > 1:
            self._per_sample.clear()
        elif samples:
            self._per_sample.append(self._frames)
        self._frames *= not samples

    def _compare(self, moved: tuple[SE2, Array] | None) -> None:
        """Compares the last step's yaw with the odometry's. Skipped at rest: otherwise the variance of the window would
        grow without bound."""
        if moved is None or self._span_s == 0.0 or moved[0] == SE2():
            self._yaw = self._yaw.restarted()
            return
        yaw_rad, variance = moved[0].yaw_rad, float(moved[1][2, 2]) + (0.01 * self._span_s) ** 2
        self._yaw = self._yaw.updated(self._turned_rad, yaw_rad, variance)

    def _guilty(self) -> str:
        """Why a sensor is left out; empty where none is."""
        if self._off_clock >= OTHER_CLOCK:
            where = f"{abs(self._off_clock_s):.6g} s {'before' if self._off_clock_s > 0.0 else 'after'} the picture"
            return f"IMU: its newest sample is {where} (two clocks?)"
        for sensor in (self._gyro, self._accel):
            if sensor.bad:
                return sensor.reason
        frames = (sum(self._per_sample) - max(self._per_sample, default=0)) / (SINGLE - 1)  # one may be a hole
        self._slow = len(self._per_sample) == SINGLE and frames > (1.5 if self._slow else 2.0)
        if self._slow:
            return f"IMU: one sample in {frames:.1f} frames, at least one in two is needed"
        if self._yaw.state is Trust.DISTRUSTED:
            return f"gyro: its yaw is {100.0 * self._yaw.ratio:.0f} % of what the camera measures"
        return ""
