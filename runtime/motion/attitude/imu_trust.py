"""Whether gyro and accelerometer are used: their clock, full scale, impossible values, too few samples, and yaw."""

import math
from collections import deque
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import GRAVITY_M_S2, small_rotation
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.judge import MotionJudge, Path, path_of, share_text
from edgemap.runtime.motion.trust import CONTRARY, Agreement, Trust, TrustRule

# By datasheets: the smallest full scale (125 deg/s, 2 g), from which on a value that repeats bit by bit is saturated,
# and the largest (2000 deg/s, 16 g).
GYRO_RAD_S, ACCEL_M_S2 = (1.5, 35.0), (15.0, 160.0)
REPEATS = 5  # of one value: a driver delivers a sample up to four times; as many of all three axes are a frozen gyro's
LIVELY = 50  # samples after which a sensor counts as one with noise
FEWEST = 10  # samples, each alone in its frame, for a rate; frames in a row whose samples are of another time
APART_S = 1.0  # between a frame and its newest sample, from which on they are of two clocks, or of two sides of a hole
HISTORY_S = 100.0  # of samples before a frame that are integrated at most
WEIGHTLESS_M_S2 = 1.0  # a sample below is none: nothing falls freely
GRAVITY_SHARES = 0.75, 1.25  # of gravity, between which the mean force of a second lies
OFF_UP_RAD = math.radians(50.0)  # of it to the mount's up, beyond what a head nods
AXES = dict(zip(("+x", "+y", "+z", "-x", "-y", "-z"), np.vstack([np.eye(3), -np.eye(3)]), strict=True))


class _Sensor:
    """One sensor's samples, judged without the other's. The sensor is bad when half of the samples over a window, or
    all of a frame's, are bad, until less than a tenth of that are."""

    def __init__(self, name: str, unit: str, bounds: tuple[float, float], window_s: float, freezes: bool) -> None:
        self.name, self._unit, self._window_s, self._freezes = name, unit, window_s, freezes
        self._least, self._most = bounds
        self._last, self._runs = np.full(3, math.nan), np.zeros(3, dtype=np.intp)
        self._share, self.bad, self.reason = 0.0, False, ""
        self._lively = 0  # samples of which every axis differed from the one before

    def judge(self, values: Array, span_s: float) -> NDArray[np.bool_]:
        """Which of the samples (N, 3) are plausible, (N,). span_s: since the samples before, 0 for the first ones."""
        rows, same = np.arange(len(values))[:, None], values == np.vstack([self._last, values[:-1]])
        changed = np.maximum.accumulate(np.where(same, -1, rows))  # row of the last change, -1 before the first one
        runs = np.where(changed < 0, self._runs + rows + 1, rows - changed)
        lively = self._lively + np.cumsum(~same.any(axis=1))
        self._last, self._runs, self._lively, size = values[-1], runs[-1], int(lively[-1]), np.abs(values)
        clipped = (runs >= REPEATS) & (size >= self._least)
        held = self._freezes & (lively >= LIVELY) & (runs.min(axis=1) >= REPEATS)
        stuck, good = clipped.any(axis=1) | held, size.max(axis=1) <= self._most
        back = np.where(held, runs.min(axis=1), np.where(clipped, runs, 0).max(axis=1))
        for at in np.flatnonzero(stuck).tolist():
            good[max(at - int(back[at]), 0) : at + 1] = False
        if not good.all():
            at = int(np.flatnonzero(~good)[-1])
            what = "saturated at" if clipped[at].any() else "frozen at" if held[at] else "at"
            self.reason = f"{self.name} {what} {size[at].max():.1f} {self._unit}{'' if stuck[at] else ': none can be'}"
        share = 1.0 - float(good.mean())
        self._share += (min(span_s / self._window_s, 1.0) if span_s else 1.0) * (share - self._share)
        self.bad = max(self._share, share / 2.0) >= (0.05 if self.bad else 0.5)
        return good


class ImuTrust:
    """Selects valid samples, and decides which sensor is excluded."""

    def __init__(self, window_s: float, trust: TrustRule, clock: str = "") -> None:
        """window_s: over which samples are judged. trust: how the gyro's yaw is compared with the odometry's. clock:
        what is wrong with the stamps of a recording's samples, all of which are left out then."""
        self._sensors = (
            _Sensor("gyro", "rad/s", GYRO_RAD_S, window_s, freezes=True),
            _Sensor("accelerometer", "m/s2", ACCEL_M_S2, window_s, freezes=False),
        )
        self._least_rad, self._yaw = trust.least[0], Agreement(trust, trust.least[0])
        self._judge, self._contrary = MotionJudge(), ""  # of delay, sign and axes
        self._recent = ImuSamples.none()  # as long as yaw is compared
        self._step, self._turned_rad = (math.nan, math.nan), 0.0  # stamps of the last two frames, and yaw by the gyro
        self._force, self.forceless = np.zeros(3), ""  # mean of a second; why the accelerometer is not used
        # Gravity's direction as a second's mean, turned by the gyro and not turned; squared errors of both; the fault.
        self._level, self._off_rad2, self._turns_gravity = np.zeros((2, 3)), np.zeros(2), ""
        self._clock, self._reason = clock, ""
        self._frames, self._per_sample = 0, deque[int](maxlen=FEWEST)  # since the last sample; of the last samples
        self._slow = False
        # Frames since the newest samples, where these are of another time; by how much.
        self._off_clock, self._off_clock_s = 0, 0.0

    @property
    def proved(self) -> bool:
        """Whether the odometry has confirmed the gyro's yaw, enough of it to show a delay, and still does."""
        return self._judge.conclusive and self._yaw.state is Trust.TRUSTED and not self._yaw.doubted

    @property
    def follows_gravity(self) -> bool:
        """Whether the accelerometer's gravity turns by the gyro's rates, so that its axes and unit are right."""
        return bool(self._off_rad2[0] < self._off_rad2[1])

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
        samples, fault = self._weighed(self._of_frame(samples, stamp_s), up)
        if fault:
            return samples, fault
        self._count(len(samples))
        if len(samples):
            self._recent = ImuSamples.joined([self._recent, samples]).between(stamp_s - self._judge.reach_s, stamp_s)
            self._compare(moved, up, bias)
            before_s = self._step[1]
            span_s = stamp_s - before_s if math.isfinite(before_s) else 0.0
            gyro, accel = self._sensors
            good = gyro.judge(samples.gyro_rad_s, span_s) & accel.judge(samples.accel_m_s2, span_s)
            known = good.all() and not self.forceless and 0.0 < span_s < APART_S
            known &= moved is None or moved[0] != SE2()
            doubted = self._weigh_turns(samples, span_s if known else 0.0, bias)
            self._step = before_s, stamp_s
            self._turned_rad = float((samples.gyro_rad_s.mean(axis=0) - bias) @ up) * span_s
            samples = samples.rows(good & (not doubted))
        before, self._reason = self._reason, self._guilty()
        return samples, _news(before, self._reason, "the IMU is left out", "the IMU (gyro and accelerometer)")

    def _of_frame(self, samples: ImuSamples, stamp_s: float) -> ImuSamples:
        """The samples up to the frame; none where the newest is more than APART_S from its stamp."""
        if not len(samples) or self._clock:
            self._off_clock += self._off_clock > 0
            return ImuSamples.none()
        self._off_clock_s = stamp_s - float(samples.stamps_s[-1])
        self._off_clock = self._off_clock + 1 if abs(self._off_clock_s) > APART_S else 0
        return ImuSamples.none() if self._off_clock else samples.between(stamp_s - HISTORY_S, stamp_s)

    def _count(self, samples: int) -> None:
        """Counts the frames per sample while no frame brings two: several at once are a driver's packet, not a low
        rate."""
        self._frames += 1
        if samples > 1:
            self._per_sample.clear()
        elif samples:
            self._per_sample.append(self._frames)
        self._frames *= not samples

    def _compare(self, moved: tuple[SE2, Array] | None, up: Array, bias: Array) -> None:
        """Compares the last step's yaw with the odometry's, and the latest ones for delay and axes. Skipped at rest:
        otherwise the variance of the window would grow without bound."""
        from_s, to_s = self._step
        if moved is None or not from_s < to_s or moved[0] == SE2():
            self._yaw = self._yaw.restarted()
            return
        if self._judge.add(from_s, to_s, moved):
            stamps_s, rates = self._recent.stamps_s, self._recent.gyro_rad_s - bias
            turns = np.cumsum(np.diff(stamps_s, prepend=stamps_s[0])[:, None] * rates, axis=0)

            def about(axis: Array) -> Path:
                return path_of(stamps_s, (turns @ axis)[:, None] * [0.0, 0.0, 1.0], wraps=False)

            wrong = partial(self._judge.judge, lengths=False)
            self._contrary = wrong(about(up))
            if self._contrary and not self._judge.delay(about(up)):
                right = next((name for name, axis in AXES.items() if not wrong(about(axis))), None)
                if right:
                    self._contrary += f"; about its {right} axis it does (are its axes right, down, ahead?)"
        yaw_rad, variance = moved[0].yaw_rad, float(moved[1][2, 2]) + (0.01 * (to_s - from_s)) ** 2
        self._yaw = self._yaw.updated(self._turned_rad, yaw_rad, variance)

    def _weigh_turns(self, samples: ImuSamples, span_s: float, bias: Array) -> bool:
        """Compares where gravity is by gyro and accelerometer with where it is by the accelerometer alone: wrong axes
        or units turn it, without any picture. Returns whether the gyro is in doubt. Starts again where the span is 0:
        one of both is wrong, or the camera rests, before which the gyro's bias is not known."""
        force = samples.accel_m_s2.mean(axis=0)
        force = force / max(float(np.linalg.norm(force)), 1e-9)
        if not self._level.any() or not span_s:
            self._level, self._off_rad2 = np.stack([force, force]), np.zeros(2)
            return False
        rate = samples.gyro_rad_s.mean(axis=0) - bias
        self._level[0] = small_rotation(*(-span_s * rate).tolist()) @ self._level[0]
        off = force - self._level
        self._level += span_s * off / APART_S
        self._off_rad2 += span_s * ((off**2).sum(axis=1) - self._off_rad2) / APART_S
        turned_rad, fixed_rad = np.sqrt(self._off_rad2).tolist()
        if turned_rad > max(CLEAR_SIGMAS * fixed_rad, self._least_rad) and not self._turns_gravity:
            by = f"{math.degrees(turned_rad):.0f} deg, {math.degrees(fixed_rad):.0f} without the gyro"
            self._turns_gravity = f"it turns gravity away from the accelerometer's (by {by}): axes or unit?"
        return turned_rad > max(CLEAR_SIGMAS * fixed_rad, self._least_rad / 2.0)

    def _weighed(self, samples: ImuSamples, up: Array) -> tuple[ImuSamples, Fault | None]:
        """The samples with a force. While the accelerometer's mean is not gravity, that of a level camera takes its
        place and the gyro goes on alone; a single sample without force is left out."""
        if not len(samples) or self._reason:
            return samples, None
        fresh, taken = samples.accel_m_s2.mean(axis=0), 1.0
        if self._force.any() or self.forceless:
            taken = min((float(np.ptp(samples.stamps_s)) or 0.01) / APART_S, 1.0)
        good = np.linalg.norm(samples.accel_m_s2, axis=1) > WEIGHTLESS_M_S2
        if not good.any() and len(samples) == 1:
            return ImuSamples.none(), None
        if good.any() and not self.forceless:
            samples = samples.rows(good)
            fresh = samples.accel_m_s2.mean(axis=0)
        self._force = self._force + taken * (fresh - self._force)
        before, self.forceless = self.forceless, _not_gravity(self._force, up)
        if self.forceless:
            samples = replace(samples, accel_m_s2=np.tile(GRAVITY_M_S2 * up, (len(samples), 1)))
        why = self.forceless and f"accelerometer: {self.forceless}"
        return samples, _news(before, why, "left out, the gyro is used alone", "the accelerometer")

    def _guilty(self) -> str:
        """Why a sensor is left out; empty where none is."""
        if self._clock:
            return self._clock
        if self._off_clock >= FEWEST:
            where = f"{abs(self._off_clock_s):.6g} s {'before' if self._off_clock_s > 0.0 else 'after'} the picture"
            return f"IMU: its newest sample is {where} (two clocks?)"
        if bad := next((sensor for sensor in self._sensors if sensor.bad), None):
            return bad.reason
        frames = (sum(self._per_sample) - max(self._per_sample, default=0)) / (FEWEST - 1)  # one may be a hole
        self._slow = len(self._per_sample) == FEWEST and frames > (1.5 if self._slow else 2.0)
        if self._slow:
            return f"IMU: one sample in {frames:.1f} frames, at least one in two is needed"
        if contrary := self._turns_gravity or self._contrary:
            return f"gyro: {contrary}"
        if self._yaw.state is Trust.DISTRUSTED and (self._judge.conclusive or self._yaw.ratio < -CONTRARY):
            return f"gyro: {share_text('yaw', self._yaw.ratio, 1.0 - self._yaw.rule.ratio)}"
        return ""


def _news(before: str, reason: str, lost: str, again: str) -> Fault | None:
    """The fault where a reason not to use a sensor begins, with its effect, or ends, with the sensor's name."""
    if bool(before) == bool(reason):
        return None
    if reason:
        return Fault(FaultKind.IMU_EXCLUDED, f"{reason}: {lost}")
    return Fault(FaultKind.IMU_RESTORED, f"{again} is used again")


def _not_gravity(force: Array, up: Array) -> str:
    """Why a mean force (3,) is not gravity on a camera whose up (3,) the mount states; empty where it is."""
    size = float(np.linalg.norm(force))
    share = size / GRAVITY_M_S2
    if not GRAVITY_SHARES[0] < share < GRAVITY_SHARES[1]:
        unit = " (in g?)" if abs(size - 1.0) < 0.25 else ""
        return f"it measures {size:.1f} m/s2 for gravity{unit}"
    off_rad = math.acos(min(max(float(force @ up) / size, -1.0), 1.0))
    if off_rad < OFF_UP_RAD:
        return ""
    return f"gravity is {math.degrees(off_rad):.0f} deg off the mount's up (sign or axes?)"
