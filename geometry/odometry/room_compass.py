"""Heading from the room: its level edges have two orthogonal directions throughout the drive (Manhattan world).

A robust smoother over the latest views of the room estimates the odometry's heading drift up to each and their common
direction; single views may be far off (rotated furniture).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import RoomAxes
from edgemap.geometry.robust import CLEAR_SIGMAS, ROUNDS

Prior = tuple[Array, Array]  # of two values, as an information matrix (2, 2), rad^-2, and its product with them

RIGHT_ANGLE = math.pi / 2.0
# Of drift since the last view; with more, one right angle cannot be distinguished from the next.
AMBIGUOUS_RAD = RIGHT_ANGLE / 4.0
CERTAIN_RAD2 = 1e-9  # variance of an exact prior
WINGS = 4  # kept in addition to the first direction
VIEWS = 40  # that are kept, and latest steps that a view can refer to: a bound on time and memory


def _wrapped(angle_rad: float) -> float:
    """The angle modulo a right angle, nearest to zero."""
    return (angle_rad + RIGHT_ANGLE / 2.0) % RIGHT_ANGLE - RIGHT_ANGLE / 2.0


@dataclass(frozen=True, slots=True)
class CompassRule:
    """Weights of the room's direction and of the odometry's yaw."""

    drift: float = 8.0  # factor on the variance of the odometry's yaw, as its errors last longer than a step
    drift_rad: float = math.radians(1.5)  # up to this standard deviation, as larger errors are stated correctly
    view_rad: float = math.radians(1.0)  # standard deviation of a view's error, in addition to that of its edges
    # Residual, in standard deviations, at which a view has a quarter of its weight (with 3.29 and without view_rad one
    # rotated piece turned home 9000, with wheels, by 22 degrees).
    outlier: float = 2.0
    # A view that neither its error nor the drift since the last one explains shows a rotated object or another wing of
    # the building: this many of them in a row become another room direction.
    alike: int = 5
    settle_s: float = 1.0  # time constant of a correction, as the steps of one second are used together


@dataclass(frozen=True, slots=True)
class Heading:
    """Integrated odometry at a stamp: yaw since the start, and its variance."""

    stamp_s: float
    yaw_rad: float = 0.0
    variance_rad2: float = 0.0


@dataclass(frozen=True, slots=True)
class RoomView:
    """direction_rad: a level direction of the room, from the odometry's heading at the start. variance_rad2: of it.
    odometry_rad2: variance of the odometry's heading there."""

    direction_rad: float
    variance_rad2: float
    odometry_rad2: float


def _initial_prior(error_rad: float) -> Prior:
    """Prior of a heading with this drift, in a room without a view yet."""
    return np.diag([1.0 / CERTAIN_RAD2, 0.0]), np.array([error_rad / CERTAIN_RAD2, 0.0])


class RoomCompass:
    """The odometry's heading drift and the room's direction; call `update` with each step.

    views: the latest ones of the room. Angles are from the heading at the start, those of other wings of the building
    from the room's direction.
    """

    def __init__(self, rule: CompassRule) -> None:
        self._rule, self._past, self.views = rule, deque[Heading](maxlen=VIEWS), list[RoomView]()
        self._prior = _initial_prior(0.0)  # of the drift up to the first view and of the room, from views before it
        self._error_rad = self._error_rad2 = 0.0  # drift up to the last view, and its variance
        self._room_rad, self._wings_rad = 0.0, deque[float](maxlen=WINGS)
        self._unexplained_rad = deque[float](maxlen=rule.alike)  # the latest views, where they fit no direction
        self._corrected_rad = 0.0  # part of the drift that was subtracted from motions
        self._unobserved_rad2 = 0.0  # variance of the heading from times without a view, which no later view reduces

    @property
    def heading_rad2(self) -> float:
        """Variance of the heading since the start as the room bounds it; infinite where no view does, rad^2."""
        if not self.views:
            return math.inf
        since_rad2 = self._past[-1].variance_rad2 - self.views[-1].odometry_rad2
        return self._unobserved_rad2 + self._error_rad2 + since_rad2 + (self._error_rad + self._corrected_rad) ** 2

    def update(self, stamp_s: float, yaw_rad: float, variance_rad2: float, room: RoomAxes | None) -> float:
        """Update with a step of the odometry, the first of which begins at its stamp, and with a view of the room in
        one of the latest steps. Returns the correction of the step's yaw, rad."""
        if not self._past:
            self._past.append(Heading(stamp_s))
            return 0.0
        rule, last = self._rule, self._past[-1]
        drift_rad2 = min(rule.drift * variance_rad2, max(variance_rad2, rule.drift_rad**2))
        self._past.append(Heading(stamp_s, last.yaw_rad + yaw_rad, last.variance_rad2 + drift_rad2))
        if room is not None and room.level_rad is not None:
            at = next((item for item in reversed(self._past) if item.stamp_s <= room.stamp_s), None)
            if at is not None:
                self._observe(at, at.yaw_rad + room.level_rad, room.sigma_rad**2 + rule.view_rad**2)
        settled = 1.0 - math.exp(-(stamp_s - last.stamp_s) / rule.settle_s)
        part = (-self._error_rad - self._corrected_rad) * settled
        self._corrected_rad += part
        return part

    def _observe(self, at: Heading, direction_rad: float, variance_rad2: float) -> None:
        """Update with a view of the room in a step, by its direction."""
        drift_rad2 = at.variance_rad2 - (self.views[-1].odometry_rad2 if self.views else 0.0)
        if not self.views or drift_rad2 > AMBIGUOUS_RAD**2:
            self._prior, self.views = _initial_prior(self._error_rad), []
            self._wings_rad.clear()
            self._unobserved_rad2 = self._unobserved_rad2 + self._error_rad2 + drift_rad2
        else:
            expected_rad = self._room_rad + self._error_rad
            from_room_rad = _wrapped(direction_rad - expected_rad)
            wings = (_wrapped(direction_rad - expected_rad - wing) for wing in self._wings_rad)
            off_rad = min((from_room_rad, *wings), key=abs)
            if abs(off_rad) > CLEAR_SIGMAS * math.sqrt(2.0 * variance_rad2 + max(drift_rad2, CERTAIN_RAD2)):
                self._count_unexplained(from_room_rad)
                return
            direction_rad = expected_rad + off_rad
        self._unexplained_rad.clear()
        self.views.append(RoomView(direction_rad, variance_rad2, at.variance_rad2))
        self._smooth()

    def _count_unexplained(self, off_rad: float) -> None:
        """Counts a view that fits no direction of the room. off_rad: from the first direction."""
        outliers = self._unexplained_rad
        outliers.append(off_rad)
        spread_rad = [_wrapped(item - off_rad) for item in outliers]
        if len(outliers) == outliers.maxlen and max(spread_rad) - min(spread_rad) <= CLEAR_SIGMAS * self._rule.view_rad:
            self._wings_rad.append(_wrapped(off_rad + sum(spread_rad) / len(spread_rad)))
            outliers.clear()

    def _smooth(self) -> None:
        """The drift at each view and the room's direction, by reweighted least squares (Geman and McClure)."""
        views, count = self.views, len(self.views)
        directions = np.array([view.direction_rad for view in views])
        variance = np.array([view.variance_rad2 for view in views])
        drift_rad2 = np.maximum(np.diff([view.odometry_rad2 for view in views]), CERTAIN_RAD2)
        drifts, ends = np.diff(np.eye(count, count + 1), axis=0), np.ix_([0, count], [0, count])
        fixed, fixed_rhs = drifts.T / drift_rad2 @ drifts, np.zeros(count + 1)
        fixed[ends] += self._prior[0]
        fixed_rhs[[0, count]] += self._prior[1]
        weight, solution, normal = 1.0 / variance, fixed_rhs, fixed
        for _ in range(ROUNDS):
            normal = fixed + np.diag(np.append(weight, weight.sum()))
            normal[:count, count] += weight
            normal[count, :count] += weight
            rhs = fixed_rhs + np.append(weight * directions, weight @ directions)
            solution = np.linalg.solve(normal, rhs)
            residual2 = (directions - solution[:count] - solution[count]) ** 2 / variance
            weight = 1.0 / (variance * (1.0 + residual2 / self._rule.outlier**2) ** 2)
        self._error_rad, self._room_rad = solution[-2:].tolist()
        self._error_rad2 = float(np.linalg.inv(normal)[count - 1, count - 1])
        if count > VIEWS:  # the first view becomes part of the prior
            covariance = np.linalg.inv(self._prior[0] + weight[0])
            mean = covariance @ (self._prior[1] + weight[0] * views.pop(0).direction_rad)
            covariance[0, 0] += drift_rad2[0]
            information = np.linalg.inv(covariance)
            self._prior = information, information @ mean
