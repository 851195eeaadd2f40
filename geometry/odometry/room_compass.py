"""Heading from the room: its level edges have two orthogonal directions throughout the drive (Manhattan world).

A robust smoother over the latest views of the room estimates the odometry's heading drift up to each and their common
direction; single views may be far off (rotated furniture).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import RoomHeading
from edgemap.geometry.robust import CLEAR_SIGMAS

Array = NDArray[np.float64]
Prior = tuple[Array, Array]  # of two values, as an information matrix (2, 2), rad^-2, and its product with them

RIGHT_ANGLE = math.pi / 2.0
LOST_RAD = RIGHT_ANGLE / 4.0  # of drift since the last view; with more, right angles could be mistaken for one another
ROUNDS = 6  # of reweighting
CERTAIN_RAD2 = 1e-9  # variance of what is given
WINGS = 4  # beside the first direction


def _wrapped(angle_rad: float) -> float:
    """Modulo a right angle, nearest to none."""
    return (angle_rad + RIGHT_ANGLE / 2.0) % RIGHT_ANGLE - RIGHT_ANGLE / 2.0


@dataclass(frozen=True, slots=True)
class CompassRule:
    """How the room's direction is weighed against the odometry's yaw.

    drift: factor on the variance of the odometry's yaw, whose errors last longer than a step; up to drift_rad of
    standard deviation, as larger errors are stated as they are. view_rad: standard deviation of a view's own error, in
    addition to that of its edges. outlier: of its standard deviations, at which a
    view counts a quarter. A view that is clearly another than that and the drift since the last one explain belongs to
    a rotated object or another wing of the building: `alike` of them in a row become another room direction. views:
    number of views kept, and of the latest steps, one of which a view is of. settle_s: over which a correction is
    spread, as the steps of one second are used together.
    """

    drift: float = 8.0
    drift_rad: float = math.radians(1.5)
    view_rad: float = math.radians(1.0)
    outlier: float = 2.0
    alike: int = 5
    views: int = 40
    settle_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Heading:
    """Integrated odometry at a stamp: yaw since the start, and its variance."""

    stamp_s: float
    yaw_rad: float = 0.0
    variance_rad2: float = 0.0


@dataclass(frozen=True, slots=True)
class RoomView:
    """shown_rad: a level direction of the room against the odometry's start. variance_rad2: of it. drift_rad2: variance
    of the odometry's heading since the view before."""

    at: Heading
    shown_rad: float
    variance_rad2: float
    drift_rad2: float


def _beginning(error_rad: float) -> Prior:
    """A heading whose drift is known, in a room that was not seen yet."""
    return np.diag([1.0 / CERTAIN_RAD2, 0.0]), np.array([error_rad / CERTAIN_RAD2, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class RoomCompass:
    """past: of the odometry, the latest steps. views: of the room. prior: of the odometry's drift up to the first of
    them and the room's direction, by views that are not kept. error_rad: the drift up to the last one. room_rad:
    direction of the room against the start. others_rad: of its other wings against that. strange_rad: of the latest
    views, if none showed a known one. paid_rad: of the drift, what motions were given back. error_rad2: variance of
    error_rad. unseen_rad2: variance of the heading from stretches without a view, which no later view reduces."""

    rule: CompassRule
    past: tuple[Heading, ...] = ()
    views: tuple[RoomView, ...] = ()
    prior: Prior = field(default_factory=lambda: _beginning(0.0))
    error_rad: float = 0.0
    room_rad: float = 0.0
    others_rad: tuple[float, ...] = ()
    strange_rad: tuple[float, ...] = ()
    paid_rad: float = 0.0
    error_rad2: float = 0.0
    unseen_rad2: float = 0.0

    @property
    def heading_rad2(self) -> float:
        """Variance of the heading since the start as the room bounds it; infinite where no view does, rad^2."""
        if not self.views:
            return math.inf
        since_rad2 = self.past[-1].variance_rad2 - self.views[-1].at.variance_rad2
        return self.unseen_rad2 + self.error_rad2 + since_rad2 + (self.error_rad + self.paid_rad) ** 2

    def moved(self, stamp_s: float, yaw_rad: float, variance_rad2: float) -> "RoomCompass":
        """The compass after a step of the odometry up to a stamp, of this yaw and its variance."""
        rule = self.rule
        drift_rad2 = min(rule.drift * variance_rad2, max(variance_rad2, rule.drift_rad**2))
        last = self.past[-1] if self.past else Heading(stamp_s)
        now = Heading(stamp_s, last.yaw_rad + yaw_rad, last.variance_rad2 + drift_rad2)
        return replace(self, past=(*self.past[1 - rule.views :], now))

    def saw(self, room: RoomHeading) -> "RoomCompass":
        """The compass after a view of the room in one of the latest steps."""
        rule = self.rule
        at = next((item for item in reversed(self.past) if item.stamp_s <= room.stamp_s), None)
        if at is None:
            return self
        shown_rad, variance_rad2 = at.yaw_rad + room.level_rad, room.sigma_rad**2 + rule.view_rad**2
        if not self.views:
            begun = replace(self, unseen_rad2=self.unseen_rad2 + at.variance_rad2)
            return begun._solved((RoomView(at, shown_rad, variance_rad2, 0.0),))
        last = self.views[-1]
        drift_rad2 = max(at.variance_rad2 - last.at.variance_rad2, CERTAIN_RAD2)
        if drift_rad2 > LOST_RAD**2:
            unseen_rad2 = self.unseen_rad2 + self.error_rad2 + drift_rad2
            begun = replace(
                self, prior=_beginning(self.error_rad), others_rad=(), strange_rad=(), unseen_rad2=unseen_rad2
            )
            return begun._solved((RoomView(at, shown_rad, variance_rad2, 0.0),))
        expected_rad = self.room_rad + self.error_rad
        off_rad = min((_wrapped(shown_rad - expected_rad - wing) for wing in (0.0, *self.others_rad)), key=abs)
        if abs(off_rad) > CLEAR_SIGMAS * math.sqrt(2.0 * variance_rad2 + drift_rad2):
            return self._puzzled(_wrapped(shown_rad - expected_rad))
        view = RoomView(at, expected_rad + off_rad, variance_rad2, drift_rad2)
        return replace(self, strange_rad=())._solved((*self.views, view))

    def paid(self, span_s: float) -> "tuple[RoomCompass, float]":
        """The yaw correction, rad, of a motion over this time, and the compass after it."""
        part = (-self.error_rad - self.paid_rad) * (1.0 - math.exp(-span_s / self.rule.settle_s))
        return replace(self, paid_rad=self.paid_rad + part), part

    def _puzzled(self, off_rad: float) -> "RoomCompass":
        """After a view of none of the known directions, so far off the first one."""
        strange = (*self.strange_rad, off_rad)[-self.rule.alike :]
        apart = [_wrapped(item - off_rad) for item in strange]
        if len(strange) < self.rule.alike or max(apart) - min(apart) > CLEAR_SIGMAS * self.rule.view_rad:
            return replace(self, strange_rad=strange)
        wing_rad = _wrapped(off_rad + sum(apart) / len(apart))
        return replace(self, others_rad=(*self.others_rad, wing_rad)[-WINGS:], strange_rad=())

    def _solved(self, views: tuple[RoomView, ...]) -> "RoomCompass":
        """The drift at each view and the room's direction, by reweighted least squares (Geman and McClure)."""
        count, shown = len(views), np.array([view.shown_rad for view in views])
        variance = np.array([view.variance_rad2 for view in views])
        tied = 1.0 / np.array([view.drift_rad2 for view in views[1:]])
        place, ends = np.arange(count), np.array([0, count])
        steady, given = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
        steady[place[:-1], place[:-1]] += tied
        steady[place[1:], place[1:]] += tied
        steady[place[1:], place[:-1]] = steady[place[:-1], place[1:]] = -tied
        steady[np.ix_(ends, ends)] += self.prior[0]
        given[ends] += self.prior[1]
        weight, found, normal = 1.0 / variance, given, steady
        for _ in range(ROUNDS):
            normal, right = steady.copy(), given.copy()
            normal[place, place] += weight
            normal[place, count] += weight
            normal[count, place] += weight
            normal[count, count] += weight.sum()
            right[:count] += weight * shown
            right[count] += weight @ shown
            found = np.linalg.solve(normal, right)
            miss2 = (shown - found[:count] - found[count]) ** 2 / variance
            weight = 1.0 / (variance * (1.0 + miss2 / self.rule.outlier**2) ** 2)
        error_rad2 = float(np.linalg.inv(normal)[count - 1, count - 1])
        solved = replace(
            self, views=views, error_rad=float(found[count - 1]), room_rad=float(found[count]), error_rad2=error_rad2
        )
        return solved._shortened(float(weight[0])) if count > self.rule.views else solved

    def _shortened(self, weight: float) -> "RoomCompass":
        """Without the first view, which counted with this weight, rad^-2: the prior takes its information."""
        first, second = self.views[:2]
        covariance = np.linalg.inv(self.prior[0] + weight)
        mean = covariance @ (self.prior[1] + weight * first.shown_rad)
        covariance[0, 0] += second.drift_rad2
        information = np.linalg.inv(covariance)
        return replace(self, views=self.views[1:], prior=(information, information @ mean))
