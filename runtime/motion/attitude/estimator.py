"""A camera's attitude by all sources together."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.floor_plane import FloorPlane, find_floor, follow_floor
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import up_optical
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.imu_trust import ImuTrust
from edgemap.runtime.motion.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.motion.attitude.mount_check import MountCheck
from edgemap.runtime.motion.attitude.pictures import LONGEST_S, PicturesAttitude
from edgemap.runtime.motion.attitude.source import AttitudeSource, Moved
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.odometry import OdometryRules

EVERY_PX = 12  # between the depths that are read
FARTHEST_RAD, FARTHEST_SHARE = math.radians(15.0), 0.3  # from the other source's up direction; of the mount's height
SOUGHT_S, SOUGHT_RAD, SOUGHT_SHARE = 0.5, math.radians(25.0), 0.15  # a lost floor: how often, how far off, and high
SLOWEST_S = 0.75  # between two samples; a slower IMU is none
Given = Callable[[float], Attitude | None]  # by stamp, None where it is not known


class DepthAttitude:
    """Roll, pitch and height by the floor plane, where the depth picture shows one."""

    name = "depth"

    def __init__(self, camera: FloorCamera, slope_rad: float) -> None:
        """slope_rad: standard deviation of the floor's slope: rugs, sills."""
        self._height_m, self._lens, self._slope_rad = camera.mount.height_m, camera.intrinsics, slope_rad
        self._last: FloorPlane | None = None
        self._seen_s = self._sought_s = -math.inf

    def predict(self, frame: Frame, other: Attitude) -> Attitude:
        """The attitude at the frame's stamp: another source's, with roll, pitch and height of the floor."""
        if frame.depth is None:
            return other
        points = SparseDepth.of(frame.depth, EVERY_PX).points(self._lens)[0]
        plane = self._floor(points, other, frame.stamp_s)
        if plane is None:
            return other
        self._last, self._seen_s = plane, frame.stamp_s
        variances = np.diag(plane.covariance)[[1, 0]] + self._slope_rad**2
        level = Attitude.of_up(plane.up, np.diag(variances), self.name)
        return other.held_to(replace(level, height_m=plane.height_m))

    def _floor(self, points: Array, other: Attitude, stamp_s: float) -> FloorPlane | None:
        """The floor near the last one or where the other source expects it; one that stays lost, as of a camera that is
        held at unexpected angles, is the lowest plane."""
        up = up_optical(other.pitch_rad, other.roll_rad)

        def near(expected: tuple[Array, float], off_rad: float, off_share: float) -> FloorPlane | None:
            plane = follow_floor(points, *expected)
            if plane is None or abs(plane.height_m / self._height_m - 1.0) >= off_share:
                return None
            return plane if float(plane.up @ up) > math.cos(off_rad) else None

        plane = None
        if self._last is not None and stamp_s - self._seen_s < LONGEST_S:
            plane = near((self._last.up, self._last.height_m), FARTHEST_RAD, FARTHEST_SHARE)
        plane = plane or near((up, other.height_m or self._height_m), FARTHEST_RAD, FARTHEST_SHARE)
        if plane is None and stamp_s - max(self._seen_s, self._sought_s) >= SOUGHT_S:
            self._sought_s = stamp_s
            lowest = find_floor(points, np.random.default_rng(0), up)
            plane = lowest and near((lowest.up, lowest.height_m), SOUGHT_RAD, SOUGHT_SHARE)
        return plane


class EstimatedAttitude(AttitudeSource):
    """Attitude by the odometry, by the IMU where frames bring samples, and by the floor where they bring depth, about a
    mount that all of them check. Each source takes precedence over the one before, poses of others over all; a gyro's
    rotation stays.

    imu: whether samples are used. clock: what is wrong with their stamps. given: by poses of others. rules: by which a
    camera counts as carried, and a gyro's yaw as wrong. health: by which a picture shows another view.
    """

    def __init__(
        self,
        camera: FloorCamera,
        rule: AttitudeRule | None = None,
        *,
        imu: bool = True,
        clock: str = "",
        given: Given | None = None,
        rules: OdometryRules | None = None,
        health: HealthRule | None = None,
    ) -> None:
        rule, rules, mount = rule or AttitudeRule(), rules or OdometryRules(), camera.mount
        super().__init__(lambda _: Attitude.of_mount(mount))
        self._pictures = PicturesAttitude(mount, rule.check.tilt)
        trust = ImuTrust(rule.noise.rest_window_s, rules.hybrid.trust, clock)
        self._inertial = InertialAttitude(mount, rule, rules.pictures.carried, trust)
        self._depth, self._imu, self._given = DepthAttitude(camera, rule.check.tilt.lasting), imu, given
        self._check = MountCheck(camera, self._pictures, rule.check, health or HealthRule())
        self._mount = mount

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:
        """The attitude at the frame's stamp."""
        mount_fault = self._check.see(frame)
        if self._check.used != self._mount:
            self._mount = self._check.used
            self._pictures.correct_mount(self._mount)
            self._inertial.correct_mount(self._mount)
        attitude = self._pictures.predict(frame.stamp_s)
        if self._imu:
            attitude = self._inertial.predict(frame, moved, attitude)
        attitude = self._depth.predict(frame, attitude)
        self.faults = tuple(fault for fault in (self._inertial.fault, mount_fault) if fault is not None)
        self._check.measure(attitude)
        self._attitude = self._about_mount(attitude)
        if self._given is not None and (given := self._given(frame.stamp_s)) is not None:
            self._attitude = self._attitude.held_to(replace(given, source="poses"))
        return self._attitude

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """As of `AttitudeSource`; that of the odometry where it was predicted."""
        self._check.moved(rotation)
        attitude = self._pictures.update(rotation)
        return self._about_mount(attitude) if self._attitude.predicted else super().update(rotation)

    def _about_mount(self, attitude: Attitude) -> Attitude:
        """An attitude with the estimate of the mount."""
        check = self._check
        return replace(attitude, carried=check.carried, room=check.room, mount=check.estimate)


def open_attitude(
    odometry: str,
    camera: Camera,
    floor: FloorCamera,
    imu: bool = True,
    rule: AttitudeRule | None = None,
    health: HealthRule | None = None,
    rules: OdometryRules | None = None,
    given: Given | None = None,
) -> AttitudeSource:
    """The attitude of this camera: recorded 6-DoF poses with `--odometry truth`, else as of `EstimatedAttitude`."""
    if odometry == "truth" and camera.info.attitudes is not None:
        return AttitudeSource(partial(camera.info.attitudes.at, height_m=floor.mount.height_m))
    clock = _clock_of(camera.info.imu)
    return EstimatedAttitude(floor, rule, imu=imu, clock=clock, given=given, rules=rules, health=health)


def _clock_of(samples: ImuSamples | None) -> str:
    """What is wrong with the stamps of a recording's samples; empty where nothing is."""
    period_s = float(np.median(np.diff(samples.stamps_s))) if samples is not None and len(samples) > 1 else 0.0
    return (
        f"IMU: one sample in {period_s:.3g} s (stamps in milliseconds or microseconds?)" if period_s > SLOWEST_S else ""
    )
