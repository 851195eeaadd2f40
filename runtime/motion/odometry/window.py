"""Odometry of a carried camera, or with depth: tracked corners in a sliding window of keyframes, optimised together."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, GyroRotation, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.odometry.keyframe_window import KeyframeWindow, WindowRule
from edgemap.geometry.odometry.resection import LensPose
from edgemap.geometry.odometry.window_factors import PoseFactors
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import CoastingRule
from edgemap.runtime.motion.odometry.corner_odometry import MINIMUM_COVARIANCE, CornerOdometry, PlanarRule
from edgemap.runtime.motion.odometry.corners import Pixels
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion, first_motion

SMALLEST_SIGMA_RAD = 1e-4  # of a tilt


class WindowOdometry(CornerOdometry):
    """Corners (`CornerTracker`) and the lens's poses in a `KeyframeWindow`; the base's motion is planar.

    Pitch, roll and height of each keyframe are estimated together with the motion, so an error of the attitude hardly
    changes the length of a step. Where a frame has depth, the inverse depths of its corners are measured. tilt: a
    carried camera is about the mount's angles to `tilt.prior`.
    """

    def __init__(
        self,
        camera: FloorCamera,
        rule: PlanarRule | None = None,
        coasting: CoastingRule | None = None,
        window: WindowRule | None = None,
        tilt: MountTiltRule | None = None,
    ) -> None:
        window, unit_m = window or WindowRule(), camera.mount.platform.unit_m
        self._window_rule = replace(window, depth_sigma=unit_m * window.depth_sigma)
        self._carried_rad = (tilt or MountTiltRule()).prior
        # Not refined by detail: what is carried turns fast, and large turns need large structures.
        super().__init__(camera, rule, coasting, tilt, detail=False, returning=True)
        self.reset("start")

    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        """The motion in the camera's unit of length."""
        dt_s = self._take(frame, prior)
        gyro = self._attend(prior.attitude)
        self._tracker.mark_floor(self._camera, prior.floor)
        first, self._first, self._seen_s = self._first, False, frame.stamp_s
        if not self._tracker.follows:
            self._seek()
            self._begin(frame, self._camera_pose(), self._factors(prior.attitude, gyro))
            if first:
                self._coasting.begin(frame.stamp_s)
                return first_motion()
            fault = Fault(FaultKind.ODOMETRY, f"planar odometry: started again at {frame.stamp_s:.3f} s")
            return self._coasting.guess(frame.stamp_s, fault)
        factors = self._factors(prior.attitude, gyro)
        start = self._expected_pose(gyro)
        self._tracker.follow(self._expected(start), gyro is None)
        self._seek()
        weight = self._graph.step(start, factors, *self._tracks(frame))
        if weight < self._rule.least_weight:
            return self._started_again(frame, start, factors)
        return self._measured(frame.stamp_s, dt_s, gyro is not None)

    def _seek(self) -> None:
        for _ in self._tracker.seek():
            pass

    def _attend(self, attitude: Attitude | None) -> GyroRotation | None:
        """Updates the camera of this frame; returns the rotation since the last picture by a gyro."""
        self._scatters(attitude)
        self._camera = self._level if attitude is None else self._level.at(self._in_units(attitude))
        gyro = None if attitude is None or self._skipped else attitude.rotation
        self._skipped = False
        used = self._mount if attitude is None or attitude.mount is None else attitude.mount.used
        corrected, self._mount = used != self._mount, used
        if corrected:
            self._graph.loosen(self._up())
        return gyro

    def _measured(self, stamp_s: float, dt_s: float, gyro: bool) -> Motion:
        """The motion since the last picture, by the window's last two poses."""
        before, pose = self._graph.poses[-2:]
        base = self._graph.base(pose)
        motion = (self._base @ self._since).inverse() @ base
        covariance = self._graph.covariance()
        by = np.zeros((3, 12))
        level = self._base.rotation().T
        by[:2, 3:5], by[:2, 9:11], by[2, 2], by[2, 8] = -level, level, -1.0, 1.0
        by[0, 2], by[1, 2] = motion.y_m, -motion.x_m
        total = by @ covariance @ by.T + MINIMUM_COVARIANCE + self._since_covariance
        self._coasting.saw(motion, stamp_s)
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._base, self._motion = base, motion
        nod = pose.rotation[2] - before.rotation[2]
        carried = self.sways(float(nod @ nod) / 2.0, self._metres(motion), dt_s, gyro)
        turned = covariance[:3, :3] + covariance[6:9, 6:9] - covariance[:3, 6:9] - covariance[6:9, :3]
        sigma_rad = math.sqrt(max(float(np.trace(turned)) / 3.0, 0.0))
        up_rad = math.sqrt(max(float(np.trace(covariance[6:8, 6:8])) / 2.0, 0.0))
        rotation = before.rotation.T @ pose.rotation
        seen = TrackedRotation(rotation, sigma_rad, carried, up=pose.rotation[2], up_rad=up_rad)
        return Motion(motion, total, rotation=seen)

    def _started_again(self, frame: Frame, start: LensPose, factors: PoseFactors) -> Motion:
        """A new window, from the expected pose, after a picture that agrees with no motion."""
        text = f"planar odometry: no motion agrees among {len(self._tracker.corners)} corners"
        guess = self._coasting.guess(frame.stamp_s, Fault(FaultKind.ODOMETRY, text))
        self._motion = guess.motion
        self._begin(frame, start, factors)
        return guess

    def _begin(self, frame: Frame, start: LensPose, factors: PoseFactors) -> None:
        """A new window at this pose."""
        self._graph = self._empty()
        self._graph.step(start, factors, *self._tracks(frame))
        self._base = self._graph.base(start)
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))

    def _tracks(self, frame: Frame) -> tuple[NDArray[np.int64], Array, Array, Array]:
        """Ids, normalised image points, probability of floor and measured inverse depth of the corners."""
        ids, points, floor, depth_m = self._tracker.tracks(frame.depth)
        return ids, points, floor, self._unit_m / depth_m

    def _empty(self) -> KeyframeWindow:
        lens, mount = self._level.intrinsics, self._level.mount
        return KeyframeWindow(self._window_rule, lens.fx, mount, self._rule.reach_heights)

    def _up(self) -> Array:
        return up_optical(self._camera.mount.pitch_rad, self._camera.mount.roll_rad)

    def _factors(self, attitude: Attitude | None, gyro: GyroRotation | None) -> PoseFactors:
        """Gravity, height and gyro as factors of this picture's pose."""
        rule, height_m = self._window_rule, self._camera.mount.height_m
        variance = 0.0 if attitude is None else float(np.trace(attitude.covariance_rad2)) / 2.0
        # A person does not hold the camera at the mount's angles.
        unknown = attitude is None or attitude.source == "mount"
        up_rad = self._carried_rad if unknown else max(math.sqrt(rule.attitude_pictures * variance), SMALLEST_SIGMA_RAD)
        gyro_rad = math.inf
        if gyro is not None:
            gyro_rad = math.hypot(rule.gyro_rad + rule.gyro_share * gyro.angle_rad, gyro.sigma_rad)
        return PoseFactors(
            self._up(), up_rad, height_m, rule.height_share * height_m, rule.rise_share * height_m,
            np.eye(3) if gyro is None else gyro.rotation, gyro_rad,
        )  # fmt: skip

    def _camera_pose(self) -> LensPose:
        """The pose of the camera on its mount, above the origin."""
        mount = self._camera.mount
        return LensPose(mount.rotation_base_optical(), mount.position_base_m())

    def _expected_pose(self, gyro: GyroRotation | None) -> LensPose:
        """The expected pose: the last motion again, with the gyro's rotation."""
        last = self._graph.poses[-1]
        moved = self._base @ self._since @ self._motion @ self._base.inverse()
        turn = np.eye(3)
        turn[:2, :2] = moved.rotation()
        rotation = turn @ last.rotation if gyro is None else last.rotation @ gyro.rotation
        return LensPose(rotation, turn @ last.position_m + [moved.x_m, moved.y_m, 0.0])

    def _expected(self, pose: LensPose) -> Pixels:
        """Where the corners are expected from this pose, (N, 2) px."""
        local = self._graph.local(self._tracker.ids, pose)
        expected = self._tracker.intrinsics.project(np.where(local[:, 2:] > 0.1, local, np.nan))
        return np.where(np.isfinite(expected), expected, self._tracker.corners).astype(np.float32)

    def _start_again(self) -> None:
        super()._start_again()
        self._graph = self._empty()
        self._base = SE2()
