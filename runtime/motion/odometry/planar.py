"""Odometry without a neural network: it tracks corners from frame to frame and keeps them as landmarks."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, GyroRotation, TrackedDirection, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.odometry.landmarks import (
    BELOW_COUNT,
    KNOWN_DEPTH,
    Landmarks,
    Located,
    Noise,
    Viewpoint,
    displacement,
    excess_scale,
    locate,
    new_landmarks,
    project,
    reduce_tilt,
    refined,
    rescaled,
    rotated,
    rotation_between,
    scaled_by_floor,
    with_neighbours_depth,
)
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.odometry.two_view import travelled
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, CoastingRule
from edgemap.runtime.motion.odometry.corner_odometry import MINIMUM_COVARIANCE, CornerOdometry, PlanarRule
from edgemap.runtime.motion.odometry.corners import FEW, Pixels
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion, first_motion

Array = NDArray[np.float64]


class PlanarOdometry(CornerOdometry):
    """Corners as landmarks, and the pose relative to them (`locate`)."""

    def __init__(
        self,
        camera: FloorCamera,
        rule: PlanarRule | None = None,
        coasting: CoastingRule | None = None,
        tilt: MountTiltRule | None = None,
    ) -> None:
        self._in_room = camera.mount.platform.in_room
        super().__init__(camera, rule, coasting, tilt, detail=self._in_room)
        rule = self._rule
        focal = self._level.intrinsics.fx
        noise = Noise(rule.track_sigma_px / focal, rule.drift_sigma_px / focal)
        self._level_noise = self._noise = noise
        self._reach_m = rule.reach_heights * self._level.mount.height_m
        self._sees_floor = False  # the bundle has a floor head
        self._attitude: Attitude | None = None
        self._spacing_px = self._tracker.spacing_px
        self._unseen_m_s = self._coasting_rule.speed_sigma_m_s
        self.reset("start")

    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        """The motion in the camera's unit of length."""
        dt_s = self._take(frame, prior)
        self._attend(prior.attitude)
        self._sees_floor = prior.floor is not None
        self._tracker.mark_floor(self._camera, prior.floor)
        first, self._first, self._seen_s = self._first, False, frame.stamp_s
        if not self._tracker.follows:
            self._floor_s = frame.stamp_s
            self._seek()
            if first:
                self._coasting.begin(frame.stamp_s)
                return first_motion()
            fault = Fault(FaultKind.ODOMETRY, f"planar odometry: started again at {frame.stamp_s:.3f} s")
            return self._coasting.guess(frame.stamp_s, fault)
        self._choose(self._tracker.follow(self._expected(), not self._rotation_known))
        located = self._locate() if len(self._landmarks) >= self._rule.least_weight else None
        if located is None or located.weights.sum() < self._rule.least_weight:
            return self._guess(frame)
        motion = (self._view.pose @ self._since).inverse() @ located.view.pose
        self._coasting.saw(motion, frame.stamp_s)
        rotation = np.eye(3)
        rotation[:2, :2] = motion.rotation()
        now = located.covariance[:3, :3]
        inflation = (len(located.weights) / located.weights.sum()) ** 2  # new tracks agree with any motion
        covariance = inflation * (self._covariance + rotation @ now @ rotation.T) + MINIMUM_COVARIANCE
        covariance += self._since_covariance
        scale2 = self._scale_variance(located, frame.stamp_s)
        covariance[:2, :2] += scale2 * np.outer(*[motion.vector()[:2]] * 2)
        if self.judged.on_wheels:  # a collapsed scale makes every motion small
            covariance[0, 0] += scale2 * (self._unseen_m_s * dt_s) ** 2
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._learn_nodding(located.view, motion, dt_s)
        self._learn_rolling(located, motion)
        seen = self._seen_rotation(located)
        self._view, self._motion, self._covariance = located.view, motion, now
        self._landmarks, keep = refined(self._landmarks, located, self._noise)
        self._keep(keep & (self._landmarks.age < self._rule.max_age))
        held = self._in_room or int(self._landmarks.floor.sum()) >= BELOW_COUNT
        factor = excess_scale(self._landmarks, held)
        if factor != 1.0:
            self._landmarks = rescaled(self._landmarks, self._camera, self._view, factor, self._noise)
            motion = self._motion = SE2(motion.x_m / factor, motion.y_m / factor, motion.yaw_rad)
        if not self._predicted:
            self._landmarks, self._view = reduce_tilt(self._landmarks, self._camera, self._view, self._levelling)
        direction = self._travelled()
        self._seek()
        return Motion(motion, covariance, rotation=replace(seen, travelled=direction))

    def rest(self, stamp_s: float) -> Motion:
        """Also shifts the stamp of the last floor observation."""
        if self._tracker.started:
            self._floor_s += stamp_s - self._seen_s
        return super().rest(stamp_s)

    def _start_again(self) -> None:
        super()._start_again()
        self._view, self._covariance = Viewpoint(), np.zeros((3, 3))
        self._landmarks = Landmarks.none()
        self._keyframe = self._view, self._camera, np.zeros((0, 3))  # rays then; NaN for later corners
        self._tilt = self._view.tilt
        self._rotation_known = self._predicted = False
        self._levelled_rad = math.inf  # sigma of the IMU tilt that the landmarks already include
        self._floor_s = self._seen_s

    def _scale_variance(self, located: Located, stamp_s: float) -> float:
        """Relative variance of the length of the motion. It grows while no floor is in view."""
        of_scale = self._landmarks.floor
        if float(located.weights[of_scale].sum()) >= self._rule.least_weight:
            self._floor_s = stamp_s
        drifted = self._rule.scale_drift_per_s * (stamp_s - self._floor_s)
        return drifted**2 + (self._noise.tilt_rad**2 if self._rotation_known else 0.0)

    def _attend(self, attitude: Attitude | None) -> None:
        """Updates the camera of this frame, the uncertainty of its attitude, and the rotation from a gyro."""
        self._camera_before = self._camera
        self._scatters(attitude)
        if attitude is not None and attitude is not self._attitude:
            self._attitude, self._camera = attitude, self._level.at(self._in_units(attitude))
            sigma = max(math.sqrt(float(np.trace(attitude.covariance_rad2)) / 2.0), self._level_noise.floor_tilt_rad)
            self._noise = replace(self._level_noise, tilt_rad=sigma)
        ahead = attitude is not None and attitude.predicted and attitude.source != "mount"
        mount, share = self._mount, self._rule.levelling
        if attitude is not None and attitude.mount is not None and attitude.mount.used != mount:
            self._mount, share = attitude.mount.used, 1.0  # the landmarks were placed with an incorrect mount
        # The rotation or the mount of the previous camera was corrected; what remains of the tilt is an error.
        if ahead or self._predicted or self._mount != mount:
            tilt = rotated(self._view.tilt, self._camera_before, np.eye(3), self._camera)
            view = Viewpoint(self._view.pose, tilt, self._view.rise_m)
            self._landmarks, self._view = reduce_tilt(self._landmarks, self._camera, view, share)
            self._camera_before = self._camera
        self._predicted = ahead
        rotation = None if attitude is None or self._skipped else attitude.rotation
        self._rotation_known = rotation is not None
        self._tilt, self._levelling, self._skipped = self._view.tilt, self._rule.levelling, False
        if rotation is None:
            self._levelled_rad = math.inf
            return
        self._retilt(rotation)
        tilt = rotated(self._view.tilt, self._camera_before, rotation.rotation, self._camera)
        self._motion = SE2(self._motion.x_m, self._motion.y_m, rotation.yaw_rad)
        self._noise = replace(self._noise, floor_tilt_rad=self._noise.tilt_rad)
        self._tilt, self._levelling = tilt, 0.0

    def _retilt(self, rotation: GyroRotation) -> None:
        """Updates the attitude of the previous picture's camera. The landmarks rotate with it by the share by which the
        variance of the tilt has decreased.
        """
        mount, sigma_rad = self._camera.mount, self._noise.tilt_rad
        up = rotation.rotation @ up_optical(mount.pitch_rad, mount.roll_rad)
        level = Attitude.of_up(up, np.eye(2) * sigma_rad**2, "imu")
        before = self._level.at(replace(level, height_m=self._camera_before.mount.height_m))
        tilt = rotated(self._view.tilt, self._camera_before, np.eye(3), before)
        share = max(1.0 - (sigma_rad / self._levelled_rad) ** 2, self._rule.levelling)
        drift = self._rule.levelling * max(sigma_rad**2 - self._levelled_rad**2, 0.0)
        self._levelled_rad = min(sigma_rad, math.sqrt(self._levelled_rad**2 + drift))
        view = Viewpoint(self._view.pose, tilt, self._view.rise_m)
        self._landmarks, self._view = reduce_tilt(self._landmarks, before, view, share)
        self._camera_before = before

    def _on_floor(self, corners: Pixels) -> NDArray[np.bool_]:
        """Whether each corner (N, 2) may count as floor immediately, (N,)."""
        trusted = self._tracker.on_floor(corners) if self._sees_floor else np.asarray(self._trusting())
        return np.asarray(trusted & ~self._tracker.doubtful(corners))

    def _locate(self) -> Located:
        """The view with which the landmarks agree."""
        seen, corners = self._tracker.bearings(self._tracker.corners), self._tracker.corners
        start = self._ahead(self._since @ self._motion)
        options = self._tracker.doubtful(corners), self._rolls()
        located = locate(self._landmarks, seen, self._camera, start, self._noise, *options)
        if self._sees_floor and self.judged.on_wheels:
            enough = self._rule.trusted_share, self._rule.least_weight
            self._landmarks, located = scaled_by_floor(
                self._landmarks, seen, self._camera, start, self._noise, located, enough, *options
            )
        return located

    def _rolls(self) -> tuple[SE2, Rolling] | None:
        """The previous pose and the rolling model, if the robot is on wheels and that pose was measured."""
        rolls = self.judged.on_wheels and self._slides < 0.5 and self._since == SE2()
        return (self._view.pose, self._rolling) if rolls else None

    def _learn_rolling(self, located: Located, motion: SE2) -> None:
        """Estimates the position of the axle, and whether the robot can drive sideways."""
        if located.lateral is not None:
            self._slides += (located.slid - self._slides) / self._rule.max_age
            self._rolling = self._rolling.learnt(*located.lateral, motion.yaw_rad)

    def _ahead(self, motion: SE2) -> Viewpoint:
        """The view after a motion, with the current tilt and the previous height."""
        return Viewpoint(self._view.pose @ motion, self._tilt, self._view.rise_m)

    def _seen_rotation(self, located: Located) -> TrackedRotation:
        """Rotation of the camera since the previous picture, relative to the landmarks."""
        rotation = rotation_between(self._view, self._camera_before, located.view, self._camera)
        return TrackedRotation(rotation, math.sqrt(float(np.trace(located.covariance[3:5, 3:5]))), self.judged)

    def _travelled(self) -> TrackedDirection | None:
        """Direction in which the lens moved since the keyframe, after the corners have moved enough. Then a new
        keyframe begins. It uses no landmark depth, because the depth of floor landmarks depends on the mount.
        """
        view, camera, rays = self._keyframe
        now = unit_depth(self._tracker.bearings(self._tracker.corners))
        both = np.isfinite(rays[:, 0])
        direction = None
        if both.sum() >= self._rule.corners // FEW:
            first, second = rays[both], now[both]
            rotation = rotation_between(view, camera, self._view, self._camera)
            turned = second @ rotation.T
            du, dv = (turned[:, :2] / turned[:, 2:] - first[:, :2]).T
            if float(np.median(np.hypot(du, dv))) < self._rule.travelled_rad:
                return None
            moved = displacement(view, camera, self._view, self._camera)
            length = float(np.linalg.norm(moved))
            if length > 0.0:
                direction = travelled(first, second, rotation, moved / length, self._noise.track_rad)
        self._keyframe = self._view, self._camera, now
        return direction

    def _learn_nodding(self, view: Viewpoint, motion: SE2, dt_s: float) -> None:
        """Updates the nodding between pictures. A camera that nods is carried by a person, and its height varies."""
        before, now = self._camera_before.mount, self._camera.mount
        pitch_rad = now.pitch_rad + view.tilt.pitch_rad - before.pitch_rad - self._view.tilt.pitch_rad
        roll_rad = now.roll_rad + view.tilt.roll_rad - before.roll_rad - self._view.tilt.roll_rad
        self.sways((pitch_rad**2 + roll_rad**2) / 2.0, self._metres(motion), dt_s, self._rotation_known)

    def _guess(self, frame: Frame) -> Motion:
        """Handles a tracking failure: starts with new corners at the predicted view."""
        text = f"planar odometry: no motion agrees among {len(self._landmarks)} floor corners"
        guess = self._coasting.guess(frame.stamp_s, Fault(FaultKind.ODOMETRY, text))
        self._view = self._ahead(self._since @ guess.motion)
        self._motion = guess.motion
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._keep(np.zeros(len(self._landmarks), dtype=bool))
        self._seek()
        return guess

    def _expected(self) -> Pixels:
        """Where the corners are expected in this picture, (N, 2) px."""
        projection = project(self._landmarks, self._camera, self._ahead(self._since @ self._motion))
        expected = self._camera.intrinsics.project(
            np.column_stack([projection.predicted, np.where(projection.ahead, 1.0, np.nan)])
        )
        return np.where(np.isfinite(expected), expected, self._tracker.corners).astype(np.float32)

    def _keep(self, which: NDArray[np.bool_]) -> None:
        self._tracker.keep(which)
        self._choose(which)

    def _choose(self, which: NDArray[np.bool_]) -> None:
        """The landmarks of the corners that are left."""
        self._landmarks = self._landmarks.chosen(which)
        self._keyframe = *self._keyframe[:2], self._keyframe[2][which]

    def _seek(self) -> None:
        """Landmarks of new corners."""
        for fresh in self._tracker.seek(int(self._landmarks.floor.sum())):
            old = self._tracker.corners[: len(self._landmarks)]
            rays = unit_depth(self._tracker.bearings(fresh))
            new = new_landmarks(rays, self._camera, self._view, self._noise, self._reach_m, self._on_floor(fresh))
            if self.judged.on_wheels:
                apart2 = ((fresh[:, None] - old) ** 2).sum(axis=2)
                near = np.exp(-apart2 / (2.0 * self._spacing_px**2))
                new = with_neighbours_depth(new, near, self._landmarks, self._camera, self._view, self._noise)
            self._landmarks = self._landmarks.joined(new)
            self._keyframe = *self._keyframe[:2], np.concatenate([self._keyframe[2], np.full((len(fresh), 3), np.nan)])

    def _trusting(self) -> bool:
        """Whether corners below the horizon count as floor immediately."""
        kept, lost_s = self._landmarks, self._seen_s - self._floor_s
        decided = int((kept.floor | (kept.variance < (KNOWN_DEPTH * kept.inverse_m) ** 2)).sum())
        return decided < self._rule.corners // FEW or (self.judged.on_wheels and lost_s > LONGEST_DT_S)


def unit_depth(bearings: Array) -> Array:
    """Rays (N, 3) with z = 1 of normalised image points (N, 2)."""
    return np.column_stack([bearings, np.ones(len(bearings))])
