"""Judges a source of motion by the camera: delay, sign, axes, and scale of rotations and of lengths."""

import cmath
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.robust import CLEAR_SIGMAS, FEWEST, median_and_scatter
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.timing import StreamTimer

LEAST = 0.12, 0.2  # yaw in rad and length in m of a motion that is compared
CLEARER = 0.8  # of what a delay leaves unexplained against none (0.1 s: 0.1 to 0.7)
OFTEN = 0.1  # share of steps of over a radian, from which on yaw is in degrees: wraps at pi are rare
LAGS_S = np.arange(-1.2, 1.21, 0.05)  # delays that are tried

Rows = NDArray[np.intp]
Path = Callable[[Array], Array]  # poses x, y, yaw (N, 3) at stamps (N,): m, m, rad without wraps; NaN where unknown


@dataclass(frozen=True, slots=True)
class JudgeRule:
    """When a source counts as wrong. Of 9 drives with true poses, the camera's yaw and length erred by up to 10 and 12
    % for 20 s, its direction by 3 degrees, and the delay by 0.05 s; correlations stayed above 0.96.
    """

    span_s: float = 20.0  # of the newest motion, that is judged
    sigma: float = 0.04  # standard deviation of the camera's scale, of lengths and of rotations, relative
    turned_rad: float = math.radians(15.0)  # between the direction of motion of both; a mount states no yaw
    lag_s: float = 0.08  # a longer delay is one
    follows: float = 0.5  # least squared correlation of two measurements of one motion


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """N steps of both: spans (N, 2) in s, the camera's motions (N, 3) with variances, the source's motions, the block
    of each step, and the blocks with a clear turn."""

    spans: Array
    seen: Array
    given: Array
    variances: Array
    block: Rows
    turned: Rows


class MotionJudge:
    """Call `add` with every step of the camera and `judge` with the source's path; the same for every kind of source.

    conclusive: whether the camera has turned enough to judge.
    """

    def __init__(self, rule: JudgeRule | None = None, least: tuple[float, float] = LEAST) -> None:
        """least: yaw in rad and length in m of a block that counts."""
        self._rule, (self._least_rad, self._least_m) = rule or JudgeRule(), least
        # The camera's steps, (8,) each: span in s, motion x, y, yaw and its variances.
        self._steps, self._timer = deque[Array](), StreamTimer(EVERY_S)
        self.conclusive = False

    @property
    def reach_s(self) -> float:
        """For how long a source's path is needed."""
        return self._rule.span_s + 2.0 * float(LAGS_S[-1])

    def add(self, from_s: float, to_s: float, moved: tuple[SE2, Array] | None) -> bool:
        """A step of the camera: its motion and covariance (3, 3), None where it was not measured. Returns whether it is
        time to judge."""
        if moved is not None and math.isfinite(from_s):
            self._steps.append(np.array([from_s, to_s, *moved[0].vector(), *np.diag(moved[1])]))
        while self._steps and self._steps[0][0] < to_s - self._rule.span_s:
            self._steps.popleft()
        return self._timer.due(to_s)

    def judge(self, path: Path, lengths: bool = True) -> str:
        """What is wrong with a source, in words; empty where nothing is, or it cannot be judged yet. lengths: whether
        it measures lengths, or yaw alone."""
        compared = self._compared(path)
        return self._late(path, compared) or self._yaw(compared) or (self._length(compared) if lengths else "")

    def delay(self, path: Path) -> str:
        """By how much a source's yaw follows late or early, in words; empty as of `judge`."""
        return self._late(path, self._compared(path))

    def _late(self, path: Path, compared: _Compared) -> str:
        if len(compared.turned) < FEWEST:
            return ""
        yaw = compared.seen[:, 2]
        match = [_correlation(yaw, _between(path, compared.spans, lag_s)[:, 2]) for lag_s in LAGS_S]
        here, best = _correlation(yaw, compared.given[:, 2]), int(np.argmax(match))
        better = 1.0 - match[best] < CLEARER * (1.0 - here)
        if match[best] > self._rule.follows and abs(LAGS_S[best]) > self._rule.lag_s and better:
            late = "late" if LAGS_S[best] > 0.0 else "early"
            return f"it is {abs(LAGS_S[best]):.2f} s {late} against the pictures"
        return ""

    def _compared(self, path: Path) -> _Compared:
        """The steps that the source measured too."""
        steps = np.array(self._steps).reshape(-1, 8)
        given = _between(path, steps[:, :2], 0.0)
        known = np.isfinite(given).all(axis=1)
        steps, given = steps[known], given[known]
        spans, seen, variances = steps[:, :2], steps[:, 2:5], steps[:, 5:]
        block = np.unique(np.floor(spans[:, 1] / EVERY_S), return_inverse=True)[1]  # as long as between two judgements
        turned = _blocks(block, np.abs(seen[:, 2]), variances[:, 2], self._least_rad)
        self.conclusive |= len(turned) >= FEWEST
        return _Compared(spans, seen, given, variances, block, turned)

    def _yaw(self, compared: _Compared) -> str:
        if len(compared.turned) < FEWEST:
            return ""
        yaw, given = compared.seen[:, 2], compared.given[:, 2]
        if abs(here := _correlation(yaw, given)) < self._rule.follows:
            return f"its yaw does not follow the camera's (correlation {here:.2f})"
        return self._ratio("yaw", given, yaw, compared.turned, compared.block)

    def _length(self, compared: _Compared) -> str:
        seen, given, block = compared.seen, compared.given, compared.block
        ahead, other = seen[:, 0] + 1j * seen[:, 1], given[:, 0] + 1j * given[:, 1]
        clear = _blocks(block, np.abs(ahead), compared.variances[:, 0], self._least_m)
        if len(clear) < FEWEST:
            return ""
        product = complex(np.vdot(ahead, other))
        power, given_power = (float(np.vdot(some, some).real) for some in (ahead, other))
        if given_power < 1e-4 * power:
            return "it reports standstill while the camera moves"
        if abs(product) ** 2 < self._rule.follows * power * given_power:
            return "its motion does not follow the camera's: are its axes x forward, y left, z up?"
        if abs(angle := cmath.phase(product)) > self._rule.turned_rad:
            return f"its axes are turned by {math.degrees(angle):.0f} deg against the camera's motion"
        along = (ahead.conj() * other).real / np.maximum(np.abs(ahead), 1e-9)
        return self._ratio("length", along, np.abs(ahead), clear, block)

    def _ratio(self, name: str, given: Array, seen: Array, clear: Rows, block: Rows) -> str:
        """Whether a quantity's sums over the clear blocks have the same size."""
        ratios = np.array([given[block == one].sum() / seen[block == one].sum() for one in clear])
        middle, scatter = map(float, median_and_scatter(ratios))
        sigma = math.hypot(self._rule.sigma, scatter / (max(abs(middle), 1e-3) * math.sqrt(len(ratios))))
        if middle > 0.0 and abs(math.log(middle)) < CLEAR_SIGMAS * sigma:
            return ""
        return share_text(name, middle, CLEAR_SIGMAS * sigma)


UNITS = {
    "yaw": {"degrees": math.degrees(1.0), "the sign is reversed": -1.0},
    "length": {"millimetres": 1000.0, "centimetres": 100.0, "kilometres": 0.001, "backwards": -1.0},
}


def share_text(name: str, share: float, tolerance: float) -> str:
    """How much of what the camera measures a source does, and the unit or sign that explains it to a tolerance. name:
    yaw or length."""
    likely = (unit for unit, size in UNITS[name].items() if abs(share / size - 1.0) < tolerance)
    return f"its {name} is {100.0 * share:.0f} % of what the camera measures{''.join(f' ({unit}?)' for unit in likely)}"


def _between(path: Path, spans: Array, lag_s: float) -> Array:
    """Motions x, y, yaw (N, 3) of a path over spans (N, 2) that are later by a lag, each in its first frame."""
    first, last = path(spans[:, 0] + lag_s), path(spans[:, 1] + lag_s)
    moved = last - first
    c, s = np.cos(first[:, 2]), np.sin(first[:, 2])
    return np.column_stack([c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0], moved[:, 2]])


def _correlation(one: Array, other: Array) -> float:
    """Their product over their sizes, squared, with its sign, of the entries that both have."""
    known = np.isfinite(other)
    one, other = one[known], other[known]
    if known.mean() < 0.5:
        return 0.0
    product, power = float(one @ other), float(one @ one) * float(other @ other)
    return math.copysign(product**2 / power, product) if power > 0.0 else 0.0


def _blocks(block: Rows, size: Array, variance: Array, least: float) -> Rows:
    """The blocks in which a quantity is clear."""
    sums, noise = np.bincount(block, size), np.sqrt(np.bincount(block, variance))
    return np.flatnonzero(sums > np.maximum(least, CLEAR_SIGMAS * noise))


def path_of(stamps_s: Array, poses: Array, wraps: bool = True) -> Path:
    """The path through poses (N, 3) at increasing stamps (N,), linear between them; unknown outside. wraps: whether
    their yaw may."""
    degrees = len(poses) > 1 and float(np.mean(np.abs(np.diff(poses[:, 2])) > 1.0)) > OFTEN
    yaw = np.unwrap(poses[:, 2], period=360.0 if degrees else math.tau) if wraps else poses[:, 2]
    unwrapped = np.column_stack([poses[:, :2], yaw])

    def path(at_s: Array) -> Array:
        return np.column_stack([np.interp(at_s, stamps_s, values, np.nan, np.nan) for values in unwrapped.T])

    return path
