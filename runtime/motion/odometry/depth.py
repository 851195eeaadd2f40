"""Odometry of pictures with depth, among keyframes of measured points; planar odometry follows the others."""

import math
from dataclasses import replace

import cv2
import numpy as np

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.odometry.resection import LensPose, Resected, planar_step
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.corner_odometry import MINIMUM_COVARIANCE
from edgemap.runtime.motion.odometry.depth_keyframes import DepthKeyframes, DepthRule
from edgemap.runtime.motion.odometry.planar import PlanarOdometry
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, MotionState, no_motion
from edgemap.runtime.motion.odometry.tracked import TrackedOdometry
from edgemap.runtime.motion.odometry.window import WindowOdometry
from edgemap.runtime.network.network import Tensors


class DepthOdometry:
    """Pictures with depth are located among keyframes (`DepthKeyframes`); planar odometry follows the rest."""

    name, needs_features = "planar", False

    def __init__(
        self,
        camera: FloorCamera,
        tracked: TrackedOdometry | PlanarOdometry | WindowOdometry,
        rule: DepthRule | None = None,
    ) -> None:
        self._mount, self._tracked, self._rule = camera.mount, tracked, rule or DepthRule()
        self._keyframes = DepthKeyframes(camera.intrinsics, self._rule)
        self.reset("start")

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """The motion from depth, where the frame has any."""
        last, self._last = self._last, frame
        last_prior, self._prior = self._prior, prior
        span_s = math.inf if last is None else frame.stamp_s - last.stamp_s
        found = None
        if frame.depth is not None:
            grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
            found = self._keyframes.step(grey, frame.depth, span_s, _still(frame, prior.movers))
            if last is None:
                return Motion(state=MotionState.UNMEASURED)
        if found is None:
            return self._follow(last, last_prior, frame, features, prior)
        self._follows = False
        return self._measured(prior.attitude, found, span_s)

    def _follow(
        self, last: Frame | None, last_prior: FramePrior, frame: Frame, features: Tensors, prior: FramePrior
    ) -> Motion:
        """Planar odometry, begun with the picture before."""
        if not self._follows and last is not None:
            self._tracked.reset("begun")
            self._tracked.step(last, {}, last_prior)
        self._follows = True
        motion = self._tracked.step(frame, features, prior)
        if self.keyframes:
            rotation = np.eye(3) if motion.rotation is None else motion.rotation.rotation
            up = self._up_before(prior.attitude, rotation)
            ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
            ahead /= np.linalg.norm(ahead)
            shift = motion.motion.x_m * ahead + motion.motion.y_m * np.cross(up, ahead)
            self._keyframes.moved_on(LensPose(rotation, shift))
        return motion

    def _measured(self, attitude: Attitude | None, found: Resected, span_s: float) -> Motion:
        rotation = found.pose.rotation
        up = self._up_before(attitude, rotation)
        total, covariance = planar_step(found.pose, found.covariance, up, self._mount)
        motion = self._since.inverse() @ total
        covariance = self._rule.covariance_scale * covariance + MINIMUM_COVARIANCE + self._since_covariance
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        nod, gyro = rotation.T @ up - up, attitude is not None and attitude.rotation is not None
        carried = self._tracked.sways(float(nod @ nod) / 2.0, total, span_s, gyro, attitude)
        sigma_rad = math.sqrt(float(np.trace(found.covariance[3:, 3:])) / 3.0)
        return Motion(motion, covariance, rotation=TrackedRotation(rotation, sigma_rad, carried))

    def _up_before(self, attitude: Attitude | None, rotation: np.ndarray) -> np.ndarray:
        """Up in the picture before, (3,), optical axes. A predicted attitude is of that one."""
        if attitude is None:
            return up_optical(self._mount.pitch_rad, self._mount.roll_rad)
        up = up_optical(attitude.pitch_rad, attitude.roll_rad)
        return up if attitude.predicted or attitude.source == "mount" else rotation @ up

    @property
    def keyframes(self) -> tuple[LensPose, ...]:
        """Poses of the keyframes, in the first one's optical axes."""
        return self._keyframes.poses

    def step_blind(self, stamp_s: float, reason: str, attitude: Attitude | None = None) -> Motion:
        """Planar odometry's guess; the next picture measures the motion since the last one."""
        guess = self._tracked.step_blind(stamp_s, reason, attitude)
        self._since, self._since_covariance = self._since @ guess.motion, self._since_covariance + guess.covariance
        return guess

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:
        """None: only pictures show whether the robot stands."""
        return self._tracked.still(stamp_s, attitude)

    def rest(self, stamp_s: float) -> Motion:
        """The last picture is as of this stamp; the keyframes stay."""
        if self._last is not None:
            self._last = replace(self._last, stamp_s=stamp_s)
        self._tracked.rest(stamp_s)
        return no_motion()

    def reset(self, reason: str) -> None:
        """Start again at the next frame."""
        self._tracked.reset(reason)
        self._keyframes.reset()
        self._last: Frame | None = None
        self._prior = NO_PRIOR
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._follows = False


def _still(frame: Frame, movers: np.ndarray) -> np.ndarray:
    """(H, W) uint8: 0 where people and animals are, 255 elsewhere."""
    still = np.full(frame.image.shape[:2], 255, dtype=np.uint8)
    for x0, y0, x1, y1 in np.maximum(movers, 0.0).astype(np.intp).tolist():
        still[y0:y1, x0:x1] = 0
    return still
