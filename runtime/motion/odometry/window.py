"""Odometry of a carried camera: tracked corners in a sliding window of keyframes that are optimised together."""

import math

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, GyroRotation, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.odometry.keyframe_window import KeyframeWindow, PoseFactors, WindowRule
from edgemap.geometry.odometry.resection import LensPose
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import CoastingRule
from edgemap.runtime.motion.odometry.planar import LEVELS, MINIMUM_COVARIANCE, Pixels, PlanarOdometry, PlanarRule
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion, first_motion

CARRIED_RAD = math.radians(10.0)  # standard deviation of a carried camera's tilt about the mount's
SMALLEST_SIGMA_RAD = 1e-4  # of a given tilt
BACK_PX = 0.7  # largest difference of a corner that is tracked forward and back again


class WindowOdometry(PlanarOdometry):
    """Corners as of planar odometry; their motion is that of a `KeyframeWindow`.

    Pitch, roll and height of each keyframe are estimated together with the motion, so an error of the given attitude
    hardly changes the length of a step. No assumption is made that the base rolls: it is for carried cameras.
    """

    def __init__(
        self,
        camera: FloorCamera,
        rule: PlanarRule | None = None,
        coasting: CoastingRule | None = None,
        window: WindowRule | None = None,
    ) -> None:
        self._window_rule = window or WindowRule()
        super().__init__(camera, rule, coasting)

    def _start_again(self) -> None:
        super()._start_again()
        self._ids, self._next_id, self._ahead_pose = np.zeros(0, dtype=np.int64), 0, LensPose.origin()
        self._graph, self._base = self._new_graph(), SE2()

    def _new_graph(self) -> KeyframeWindow:
        return KeyframeWindow(self._window_rule, self._level.intrinsics.fx)

    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        last, grey, dt_s = self._taken(frame, prior)
        self._scatters(prior.attitude)
        self._camera = self._level if prior.attitude is None else self._level.at(self._in_units(prior.attitude))
        self._reached = self._within_reach(self._camera)
        self._mark_floor(prior.floor)
        self._probability = np.where(self._mask > 0, 1.0, 0.0)
        if prior.floor is not None:
            self._probability = cv2.resize(prior.floor.floor, self._size, interpolation=cv2.INTER_LINEAR)
        first, self._first, self._seen_s = self._first, False, frame.stamp_s
        gyro = None if prior.attitude is None or self._skipped else prior.attitude.rotation
        self._rotation_known, self._skipped = gyro is not None, False
        factors = self._factors(prior.attitude, gyro)
        if last is None:
            self._seek(grey)
            mount = self._camera.mount
            self._graph.step(LensPose(mount.rotation_base_optical(), mount.position_base_m()), factors, *self._tracks())
            if first:
                self._coasting.begin(frame.stamp_s)
                return first_motion()
            return self._coasting.guess(frame.stamp_s, f"planar odometry: started again at {frame.stamp_s:.3f} s")
        start = self._ahead_pose = self._start(gyro)
        self._follow(last, grey)
        self._seek(grey)
        weight = self._graph.step(start, factors, *self._tracks())
        if weight < self._rule.least_weight:
            return self._started_again(frame, start, factors)
        return self._measured(frame, dt_s)

    def _measured(self, frame: Frame, dt_s: float) -> Motion:
        """The motion since the last picture, by the window's last two poses."""
        before, pose = self._graph.poses[-2:]
        base = self._base_of(pose)
        motion = (self._base @ self._since).inverse() @ base
        covariance = self._graph.covariance()
        by = np.zeros((3, 12))
        level = self._base.rotation().T
        by[:2, 3:5], by[:2, 9:11], by[2, 2], by[2, 8] = -level, level, -1.0, 1.0
        by[0, 2], by[1, 2] = motion.y_m, -motion.x_m
        total = by @ covariance @ by.T + MINIMUM_COVARIANCE + self._since_covariance
        self._coasting.saw(motion, frame.stamp_s)
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._base, self._motion = base, motion
        rotation = before.rotation.T @ pose.rotation
        nod = pose.rotation[2] - before.rotation[2]
        carried = self.sways(float(nod @ nod) / 2.0, self._metres(motion), dt_s, self._rotation_known)
        turned = covariance[:3, :3] + covariance[6:9, 6:9] - covariance[:3, 6:9] - covariance[6:9, :3]
        sigma_rad = math.sqrt(max(float(np.trace(turned)) / 3.0, 0.0))
        up_rad = math.sqrt(max(float(np.trace(covariance[6:8, 6:8])) / 2.0, 0.0))
        seen = TrackedRotation(rotation, sigma_rad, carried, up=pose.rotation[2], up_rad=up_rad)
        return Motion(motion, total, rotation=seen)

    def _started_again(self, frame: Frame, start: LensPose, factors: PoseFactors) -> Motion:
        """A new window, from the expected pose, after a picture that agrees with no motion."""
        fault = f"planar odometry: no motion agrees among {len(self._corners)} corners"
        guess = self._coasting.guess(frame.stamp_s, fault)
        self._graph, self._motion = self._new_graph(), guess.motion
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._graph.step(start, factors, *self._tracks())
        self._base = self._base_of(start)
        return guess

    def _factors(self, attitude: Attitude | None, gyro: GyroRotation | None) -> PoseFactors:
        """What else is known of this picture's pose."""
        mount = self._camera.mount
        variance = 0.0 if attitude is None else float(np.trace(attitude.covariance_rad2)) / 2.0
        lasting = self._window_rule.attitude_pictures
        unknown = attitude is None or attitude.source == "mount"  # a person does not hold the camera at those angles
        up = up_optical(mount.pitch_rad, mount.roll_rad)
        up_rad = CARRIED_RAD if unknown else max(math.sqrt(lasting * variance), SMALLEST_SIGMA_RAD)
        if gyro is None:
            return PoseFactors(up, up_rad, mount.height_m, np.eye(3))
        sigma_rad = math.hypot(self._rule.gyro_rad + self._rule.gyro_share * gyro.angle_rad, gyro.sigma_rad)
        return PoseFactors(up, up_rad, mount.height_m, gyro.rotation, sigma_rad)

    def _start(self, gyro: GyroRotation | None) -> LensPose:
        """The expected pose: the last motion again, with the gyro's rotation."""
        last = self._graph.poses[-1]
        moved = self._base @ self._since @ self._motion @ self._base.inverse()
        turn = np.eye(3)
        turn[:2, :2] = moved.rotation()
        rotation = turn @ last.rotation if gyro is None else last.rotation @ gyro.rotation
        return LensPose(rotation, turn @ last.position_m + [moved.x_m, moved.y_m, 0.0])

    def _base_of(self, pose: LensPose) -> SE2:
        """The base below a lens."""
        mount, ahead = self._level.mount, pose.rotation[:, 2]
        lens = SE2(pose.position_m[0], pose.position_m[1], math.atan2(ahead[1], ahead[0]))
        return lens @ SE2(-mount.forward_m, -mount.left_m, 0.0)

    def _tracks(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Ids, normalised image points and probability of floor of the corners that do not lie on people."""
        corners = np.asarray(self._corners, dtype=np.float32)
        still = ~self._doubtful(corners)
        corners = corners[still]
        columns, rows = corners.astype(np.intp).T
        return self._ids[still], self._bearings(corners), self._probability[rows, columns].astype(np.float64)

    def _follow(self, last: MatLike, grey: MatLike) -> None:
        super()._follow(last, grey)
        if not len(self._corners):
            return
        back, status, _ = cv2.calcOpticalFlowPyrLK(
            grey, last, self._corners[:, None], self._before[:, None].copy(), winSize=[self._rule.window_px] * 2,
            maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        same = np.abs(back.reshape(-1, 2) - self._before).max(axis=1) < BACK_PX
        self._keep((status.reshape(-1) == 1) & same)

    def _moved(self, last: MatLike, grey: MatLike, expected: Pixels) -> tuple[Pixels, NDArray[np.bool_]]:
        return self._tracked(last, grey, self._corners, expected, LEVELS)

    def _expected(self) -> Pixels:
        local = self._graph.local(self._ids, self._ahead_pose)
        expected = self._camera.intrinsics.project(np.where(local[:, 2:] > 0.1, local, np.nan))
        return np.where(np.isfinite(expected), expected, self._corners).astype(np.float32)

    def _keep(self, which: NDArray[np.bool_]) -> None:
        self._corners, self._ids = self._corners[which], self._ids[which]

    def _floor_count(self) -> int:
        columns, rows = self._corners.astype(np.intp).T
        return int((self._mask[rows, columns] > 0).sum())

    def _begin(self, fresh: Pixels) -> None:
        self._ids = np.concatenate([self._ids, self._next_id + np.arange(len(fresh))])
        self._next_id += len(fresh)
        self._corners = np.concatenate([self._corners, fresh])
