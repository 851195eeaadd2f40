"""Heading from the room: its level edges have two orthogonal directions throughout the drive (Manhattan world).

A robust smoother over the latest views of the room estimates the odometry's heading drift up to each and their common
direction; single views may be far off (rotated furniture).
"""

import math
from dataclasses import dataclass, field, replace

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


@dataclass(frozen=True, slots=True, eq=False)
class RoomCompass:
    """A fixed-lag smoother of the odometry's heading drift and the room's direction.

    past: the odometry's latest steps. views: of the room. prior: of the drift up to the first view and of the room's
    direction, from views that are no longer kept. error_rad: drift up to the last view. room_rad: direction of the
    room from the heading at the start. wings_rad: directions of other wings from that of the room. unexplained_rad:
    the latest views' directions where they fit neither. corrected_rad: part of the drift that was subtracted from
    motions. error_rad2: variance of error_rad. unobserved_rad2: variance of the heading from times without a view,
    which no later view reduces.
    """

    rule: CompassRule
    past: tuple[Heading, ...] = ()
    views: tuple[RoomView, ...] = ()
    prior: Prior = field(default_factory=lambda: _initial_prior(0.0))
    error_rad: float = 0.0
    room_rad: float = 0.0
    wings_rad: tuple[float, ...] = ()
    unexplained_rad: tuple[float, ...] = ()
    corrected_rad: float = 0.0
    error_rad2: float = 0.0
    unobserved_rad2: float = 0.0

    @property
    def heading_rad2(self) -> float:
        """Variance of the heading since the start as the room bounds it; infinite where no view does, rad^2."""
        if not self.views:
            return math.inf
        since_rad2 = self.past[-1].variance_rad2 - self.views[-1].odometry_rad2
        return self.unobserved_rad2 + self.error_rad2 + since_rad2 + (self.error_rad + self.corrected_rad) ** 2

    def predict(self, stamp_s: float, yaw_rad: float, variance_rad2: float) -> "RoomCompass":
        """Prediction by a step of the odometry: its stamp, yaw (rad) and variance (rad^2)."""
        rule = self.rule
        drift_rad2 = min(rule.drift * variance_rad2, max(variance_rad2, rule.drift_rad**2))
        last = self.past[-1] if self.past else Heading(stamp_s)
        now = Heading(stamp_s, last.yaw_rad + yaw_rad, last.variance_rad2 + drift_rad2)
        return replace(self, past=(*self.past[1 - VIEWS :], now))

    def observe(self, room: RoomAxes) -> "RoomCompass":
        """Update with a view of the room in one of the latest steps."""
        at = next((item for item in reversed(self.past) if item.stamp_s <= room.stamp_s), None)
        if at is None or room.level_rad is None:
            return self
        direction_rad, variance_rad2 = at.yaw_rad + room.level_rad, room.sigma_rad**2 + self.rule.view_rad**2
        drift_rad2 = at.variance_rad2 - (self.views[-1].odometry_rad2 if self.views else 0.0)
        if not self.views or drift_rad2 > AMBIGUOUS_RAD**2:
            begun = replace(
                self,
                prior=_initial_prior(self.error_rad),
                wings_rad=(),
                unexplained_rad=(),
                unobserved_rad2=self.unobserved_rad2 + self.error_rad2 + drift_rad2,
            )
            return begun._smoothed((RoomView(direction_rad, variance_rad2, at.variance_rad2),))
        expected_rad = self.room_rad + self.error_rad
        off_rad = min((_wrapped(direction_rad - expected_rad - wing) for wing in (0.0, *self.wings_rad)), key=abs)
        if abs(off_rad) > CLEAR_SIGMAS * math.sqrt(2.0 * variance_rad2 + max(drift_rad2, CERTAIN_RAD2)):
            return self._unexplained(_wrapped(direction_rad - expected_rad))
        view = RoomView(expected_rad + off_rad, variance_rad2, at.variance_rad2)
        return replace(self, unexplained_rad=())._smoothed((*self.views, view))

    def correct(self, span_s: float) -> "tuple[RoomCompass, float]":
        """The correction of a motion's yaw, rad, over this time, and the compass after it."""
        part = (-self.error_rad - self.corrected_rad) * (1.0 - math.exp(-span_s / self.rule.settle_s))
        return replace(self, corrected_rad=self.corrected_rad + part), part

    def _unexplained(self, off_rad: float) -> "RoomCompass":
        """Counts a view that fits no direction of the room. off_rad: from the first direction."""
        outliers = (*self.unexplained_rad, off_rad)[-self.rule.alike :]
        spread_rad = [_wrapped(item - off_rad) for item in outliers]
        if len(outliers) < self.rule.alike or max(spread_rad) - min(spread_rad) > CLEAR_SIGMAS * self.rule.view_rad:
            return replace(self, unexplained_rad=outliers)
        wing_rad = _wrapped(off_rad + sum(spread_rad) / len(spread_rad))
        return replace(self, wings_rad=(*self.wings_rad, wing_rad)[-WINGS:], unexplained_rad=())

    def _smoothed(self, views: tuple[RoomView, ...]) -> "RoomCompass":
        """The drift at each view and the room's direction, by reweighted least squares (Geman and McClure)."""
        count, directions = len(views), np.array([view.direction_rad for view in views])
        variance = np.array([view.variance_rad2 for view in views])
        drift_rad2 = np.maximum(np.diff([view.odometry_rad2 for view in views]), CERTAIN_RAD2)
        drifts, ends = np.diff(np.eye(count, count + 1), axis=0), np.ix_([0, count], [0, count])
        fixed, fixed_rhs = drifts.T / drift_rad2 @ drifts, np.zeros(count + 1)
        fixed[ends] += self.prior[0]
        fixed_rhs[[0, count]] += self.prior[1]
        weight, solution, normal = 1.0 / variance, fixed_rhs, fixed
        for _ in range(ROUNDS):
            normal = fixed + np.diag(np.append(weight, weight.sum()))
            normal[:count, count] += weight
            normal[count, :count] += weight
            rhs = fixed_rhs + np.append(weight * directions, weight @ directions)
            solution = np.linalg.solve(normal, rhs)
            residual2 = (directions - solution[:count] - solution[count]) ** 2 / variance
            weight = 1.0 / (variance * (1.0 + residual2 / self.rule.outlier**2) ** 2)
        error_rad, room_rad = solution[-2:].tolist()
        error_rad2 = float(np.linalg.inv(normal)[count - 1, count - 1])
        solved = replace(self, views=views, error_rad=error_rad, room_rad=room_rad, error_rad2=error_rad2)
        return solved._marginalised(float(weight[0]), float(drift_rad2[0])) if count > VIEWS else solved

    def _marginalised(self, weight: float, drift_rad2: float) -> "RoomCompass":
        """Marginalises the first view, which had this weight, rad^-2, into the prior. drift_rad2: up to the next."""
        covariance = np.linalg.inv(self.prior[0] + weight)
        mean = covariance @ (self.prior[1] + weight * self.views[0].direction_rad)
        covariance[0, 0] += drift_rad2
        information = np.linalg.inv(covariance)
        return replace(self, views=self.views[1:], prior=(information, information @ mean))
