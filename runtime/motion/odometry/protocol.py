"""Interface of an odometry: frames in, motion of the base with its covariance out."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.network.network import Tensors

FARTHEST_M = 100.0  # of one step
STILL = 0.002  # m and rad of one step, below which wheels and gyro report rest; their noise is less
REST_SIGMA = 1e-5  # m and rad: standard deviations of no motion
ROUNDING = 1e-6  # of a covariance, as a share of its largest entry; networks answer in float32


def is_covariance(matrix: Array) -> bool:
    """Whether a finite matrix is symmetric with no negative eigenvalue, but for rounding."""
    if _clearly_positive(matrix.tolist()):
        return True
    slack = ROUNDING * max(float(np.abs(matrix).max()), 1e-12)
    return bool(np.abs(matrix - matrix.T).max() <= slack and np.linalg.eigvalsh(matrix)[0] >= -slack)


def _clearly_positive(rows: list[list[float]]) -> bool:
    """Whether a 2x2 or 3x3 is symmetric but for rounding, with leading minors well above zero (Sylvester): nearly all
    are, and numpy takes ten times as long."""
    (xx, xy, *_), (yx, yy, *_) = rows[:2]
    slack = ROUNDING * min(xx, yy)
    minor = xx * yy - xy * yx
    clear = abs(xy - yx) <= slack and xx > 0.0 and minor > ROUNDING * xx * yy
    if len(rows) == 2 or not clear:
        return clear
    (_, _, xz), (_, _, yz), (zx, zy, zz) = rows
    determinant = zz * minor - yz * (xx * zy - zx * xy) - xz * (zx * yy - xy * zy)
    return max(abs(xz - zx), abs(yz - zy)) <= min(slack, ROUNDING * zz) and determinant > ROUNDING * minor * zz


def unknown_covariance() -> Array:
    """Covariance of a step that was not measured at all: 1 m and about 30 degrees, (3, 3)."""
    return np.diag([1.0, 1.0, 0.25])


class MotionState(Enum):
    """Origin of a motion. MEASURED. BLIND: no measurement, a guess. UNMEASURED: the first frame, which has no
    predecessor."""

    MEASURED = "measured"
    BLIND = "blind"
    UNMEASURED = "unmeasured"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """motion: of the BASE from the previous frame to this one. covariance: (3, 3) in (m, m, rad), in the previous
    base frame. faults: what failed or was excluded. members: of a hybrid, by
    name: `used`, `blind` (no measurement) or `left_out` (it disagrees). without_gyro: of a hybrid with a gyro, motion
    and covariance from its other members. rotation: of the camera, where tracked corners measure it. lengths: of a
    hybrid, ahead by the camera and by the wheels, m. heading_rad2: variance of the sum of all yaws since the start,
    where a compass bounds it; infinite without one. instead: poses by stamp that replace those of the steps before,
    where their source has proved wrong or corrects itself; in_map: in the map's frame. gap: pictures were lost on the
    way, so that the stamps do not give its speed.
    """

    motion: SE2 = field(default_factory=SE2)
    covariance: Array = field(default_factory=unknown_covariance)
    faults: tuple[Fault, ...] = ()
    state: MotionState = MotionState.MEASURED
    members: Mapping[str, str] = field(default_factory=dict)
    without_gyro: tuple[SE2, Array] | None = None
    rotation: TrackedRotation | None = None
    lengths: tuple[float, float] | None = None
    heading_rad2: float = math.inf
    instead: Callable[[float], SE2 | None] | None = None
    in_map: bool = False
    gap: bool = False

    @property
    def measured(self) -> bool:
        """Whether it was measured."""
        return self.state is MotionState.MEASURED

    @property
    def blind(self) -> bool:
        """Whether it is a guess where there was something to measure."""
        return self.state is MotionState.BLIND

    def moved(self) -> tuple[SE2, Array] | None:
        """The motion that the next frame is judged by, without the gyro's contribution; None where it was not measured,
        or over a gap."""
        return self.without_gyro or (self.motion, self.covariance) if self.measured and not self.gap else None

    def checked(self, name: str) -> "Motion":
        """This motion if it is valid, else a blind one with a fault that names the odometry. Invalid: a motion or
        covariance that is not finite, or farther or more uncertain than FARTHEST_M in one step; a covariance that is
        not symmetric and positive."""
        values, covariance = self.motion.vector(), self.covariance
        if not (np.isfinite(values).all() and np.isfinite(covariance).all()):
            wrong = "motion not finite"
        elif np.abs(values).max() > FARTHEST_M:
            wrong = f"{values[0]:.3g}, {values[1]:.3g} m in one step"
        elif np.abs(covariance).max() > FARTHEST_M**2:
            wrong = "nothing measured how far one step is (do the stamps jump?)"
        elif not is_covariance(covariance):
            wrong = "its covariance is not positive"
        else:
            return self
        return blind_motion(Fault(FaultKind.OUT_OF_RANGE, f"{name} odometry: {wrong}"))


def no_motion() -> Motion:
    """The motion of one frame at rest. Any motion missed here is part of the first measured motion after it."""
    rest = TrackedRotation(np.eye(3))
    return Motion(covariance=np.eye(3) * REST_SIGMA**2, rotation=rest)


def blind_motion(*faults: Fault) -> Motion:
    """No measurement: identity, covariance unknown, and the reasons."""
    return Motion(faults=faults, state=MotionState.BLIND)


def first_motion(*faults: Fault) -> Motion:
    """The motion of a first frame: identity, covariance unknown."""
    return Motion(faults=faults, state=MotionState.UNMEASURED)


@dataclass(frozen=True, slots=True, eq=False)
class FramePrior:
    """Inputs of a frame's motion estimate. attitude: of the camera at the frame's stamp, with the gyro's rotation since
    the frame before. covered: share of the picture that something on the lens covers. movers: (N, 4) boxes, px, of
    people and animals; floor: the floor mask; both from this picture if the detector ran on it, else from the last such
    picture. None without a source.
    """

    attitude: Attitude | None = None
    covered: float = 0.0
    movers: Array = field(default_factory=lambda: np.zeros((0, 4)))
    floor: FloorMask | None = None


NO_PRIOR = FramePrior()


class Odometry(Protocol):
    """Fed every frame in order. The first step gives identity, covariance unknown. A subclass has `step_blind` and, if
    it needs pictures, `step`; as it is, only pictures show it whether the robot stands, and at rest it has nothing to
    store.

    needs_features: whether it cannot measure where the backbone did not run.
    """

    name: str
    needs_features: bool = False

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """The motion since the frame of the previous step. features: the backbone's outputs of this frame, empty where
        it did not run. As it is, the motion that needs no picture."""
        return self.step_blind(frame.stamp_s, None, prior.attitude)

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:
        """The motion from the previous step to a stamp without a picture, or with one that cannot be trusted.

        Wheels and gyro keep measuring; an odometry that needs pictures is blind. reason: why the picture is missing.
        attitude: at the stamp, with the gyro's rotation since the previous step, where there is an IMU.
        """
        ...

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """Whether the base has stood still from the previous step to a stamp, without the picture.

        None where neither wheels nor gyro measure.
        """
        return None

    def rest(self, stamp_s: float) -> Motion:  # noqa: ARG002
        """`no_motion`: the base stood still since the previous step; the last picture is valid for this stamp too."""
        return no_motion()
