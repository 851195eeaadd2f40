"""Base of planar and window odometry: tracked corners, units, detection of a carried camera, rest and blindness."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.carried import Carried, CarriedRule
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.odometry.landmarks import TURN_M
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.corners import CornersRule, CornerTracker
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, no_motion
from edgemap.runtime.network.network import Tensors

SHORTEST_S = 1e-3  # minimum time between two pictures
MINIMUM_COVARIANCE = np.diag([1e-4, 1e-4, 1e-4]) ** 2


@dataclass(frozen=True, slots=True)
class PlanarRule(CornersRule):
    """How planar odometry tracks (`CornersRule`) and weights corners. Lengths are in `Platform.unit_m`, one metre for
    home robots.
    """

    max_age: int = 30  # lifetime of a landmark, frames
    track_sigma_px: float = 0.3  # standard deviation of one tracked corner at the working width
    drift_sigma_px: float = 0.1  # standard deviation of its drift in one frame
    # Share of a tilt that is attributed to the landmarks instead of the camera. A tilt correction from an IMU rotates
    # the landmarks and does not count as motion.
    levelling: float = 0.25
    trusted_share: float = 0.4  # share of the landmarks on the floor that must agree
    least_weight: float = 8.0  # minimum total weight of the tracks that agree
    scale_drift_per_s: float = 0.1  # relative drift of the scale that the landmarks keep while no floor is in view
    carried: CarriedRule = field(default_factory=CarriedRule)  # for a carried camera, and for one on wheels
    # As in `Rolling`, for robots on wheels. A robot that slides in most of the steps with much floor in view counts as
    # able to drive sideways.
    lateral_share: float = 0.01
    # Median motion of the corners, without the rotation, at which the direction of motion is measured.
    travelled_rad: float = 0.035


class CornerOdometry(ABC):
    """Corners (`CornerTracker`) and the planar motion of the base that explains how they move.

    Lengths inside are in the platform's unit. If a step measures no motion, `Coasting` predicts it. tilt: a camera
    that nods by more than `tilt.nod` is carried. detail, returning: as of the tracker.
    """

    name, needs_features = "planar", False

    def __init__(
        self,
        camera: FloorCamera,
        rule: PlanarRule | None,
        coasting: CoastingRule | None,
        tilt: MountTiltRule | None,
        *,
        detail: bool,
        returning: bool = False,
    ) -> None:
        self._rule = rule = rule or PlanarRule()
        self._unit_m = camera.mount.platform.unit_m
        self._tracker = CornerTracker(camera, rule, detail, returning)
        self._level = self._camera = FloorCamera(self._tracker.intrinsics, _in_units(camera.mount, self._unit_m))
        self._mount = camera.mount  # the mount that attitudes refer to
        self.judged = Carried(rule.carried, (tilt or MountTiltRule()).nod)
        self._rolling = Rolling(rule.lateral_share, 0.0, _axle_sigma_m(self._level.mount))
        self._slides = 0.0  # share of recent pictures that contradict rolling
        self._coasting_rule = coasting or CoastingRule()
        self._coasting = Coasting(self._coasting_rule)

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """Tracks the corners of the previous frame into this frame and estimates the motion between both."""
        return self._metric(self._followed(frame, prior))

    @abstractmethod
    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        """The motion in the camera's unit of length."""

    def _start_again(self) -> None:
        """Discards the previous picture and all estimates from it."""
        self._tracker.restart()
        self._motion, self._skipped = SE2(), False
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))  # of the motion without pictures

    def _take(self, frame: Frame, prior: FramePrior) -> float:
        """Takes the picture; returns the time since the one before, s. A picture after a long pause is a start."""
        if self._tracker.started and frame.stamp_s - self._seen_s > LONGEST_DT_S:
            self._start_again()
        self._tracker.take(frame, prior.movers)
        return frame.stamp_s - self._seen_s

    def step_blind(self, stamp_s: float, reason: Fault, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """Predicts the motion without a picture. Keeps the tracks: the next picture measures the motion since the
        previous one.
        """
        guess, self._skipped = self._coasting.guess(stamp_s, reason), True
        self._since, self._since_covariance = self._since @ guess.motion, self._since_covariance + guess.covariance
        self._motion = guess.motion
        return self._metric(guess)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """None: this odometry cannot detect a standstill without pictures."""
        return None

    def rest(self, stamp_s: float) -> Motion:
        """Moves the stamp of the last picture and of its corners to this stamp, while the robot stands still."""
        if self._tracker.started:
            self._seen_s = stamp_s
        self._motion = SE2()
        self._coasting.saw(SE2(), stamp_s)
        return no_motion()

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the next frame."""
        self._first, self._seen_s = True, -math.inf
        self._coasting.reset()
        self._start_again()

    def sways(self, nod2: float, motion: SE2, span_s: float, gyro: bool, attitude: Attitude | None = None) -> Carried:
        """Updates and returns the estimate of whether the camera is carried. Call it once for each picture.

        nod2: mean square of the changes of roll and pitch since the previous picture, rad^2. motion: since the
        previous picture, metres. span_s: time since the previous picture. gyro: whether a gyro measured the rotation.
        """
        self._scatters(attitude)
        path_m = math.hypot(motion.x_m, motion.y_m) + TURN_M * abs(motion.yaw_rad)
        self.judged = self.judged.updated(nod2, max(span_s, SHORTEST_S), path_m, gyro=gyro)
        return self.judged

    def _scatters(self, attitude: Attitude | None) -> None:
        """Takes over the estimate from the edges of the room."""
        if attitude is not None and attitude.carried != self.judged.scattered:
            self.judged = replace(self.judged, scattered=attitude.carried)

    def _metric(self, motion: Motion) -> Motion:
        """Converts a motion from the camera's unit of length to metres."""
        units = np.array([self._unit_m, self._unit_m, 1.0])
        covariance = motion.covariance * np.outer(units, units)
        return replace(motion, motion=self._metres(motion.motion), covariance=covariance)

    def _metres(self, motion: SE2) -> SE2:
        return SE2(self._unit_m * motion.x_m, self._unit_m * motion.y_m, motion.yaw_rad)

    def _in_units(self, attitude: Attitude) -> Attitude:
        """An attitude whose height is in the camera's unit of length."""
        return attitude if attitude.height_m is None else replace(attitude, height_m=attitude.height_m / self._unit_m)


def _in_units(mount: Mount, unit_m: float) -> Mount:
    """A mount with its lengths in units of `unit_m`."""
    return replace(
        mount, height_m=mount.height_m / unit_m, forward_m=mount.forward_m / unit_m, left_m=mount.left_m / unit_m
    )


def _axle_sigma_m(mount: Mount) -> float:
    """Standard deviation of the axle's place: a lever arm that was not measured may be as long as the lens is high."""
    return 0.0 if mount.forward_m != 0.0 or mount.left_m != 0.0 else mount.height_m
