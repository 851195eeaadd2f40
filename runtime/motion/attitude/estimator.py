"""A camera's attitude by all sources together."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.depth import DepthAttitude
from edgemap.runtime.motion.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.motion.attitude.mount_check import MountCheck
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.runtime.motion.attitude.protocol import AttitudeSource, Moved
from edgemap.runtime.motion.attitude.sources import RecordedAttitude
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.odometry import OdometryRules

SLOWEST_S = 0.75  # between two samples; a slower IMU is none

Given = Callable[[float], Attitude | None]  # by stamp, None where it is not known


class EstimatedAttitude:
    """Attitude by pictures, by the IMU where frames bring samples, and by the floor where they bring depth, about a
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
        self._pictures = PicturesAttitude(mount, rule.check.tilt, rule.rotation_share)
        self._inertial = InertialAttitude(mount, rule, rules.pictures.carried, rules.hybrid.trust, clock)
        self._depth, self._imu, self._given = DepthAttitude(camera), imu, given
        self._check = MountCheck(camera, self._pictures, rule.check, health)
        self._mount, self.faults = mount, tuple[Fault, ...]()
        self._attitude = Attitude.of_mount(mount)

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
        """The last frame's attitude; that of the pictures, with the rotation up to it, where it was predicted."""
        self._check.moved(rotation)
        attitude, up = self._pictures.update(rotation), self._depth.up()
        if up is not None:
            self._pictures.see_up(*up)
        return self._about_mount(attitude) if self._attitude.predicted else self._attitude

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Starts all sources again; the estimate of the mount stays."""
        for source in (self._pictures, self._inertial, self._depth, self._check):
            source.reset()

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
        return RecordedAttitude(camera.info.attitudes, floor.mount)
    clock = _clock_of(camera.info.imu)
    return EstimatedAttitude(floor, rule, imu=imu, clock=clock, given=given, rules=rules, health=health)


def _clock_of(samples: ImuSamples | None) -> str:
    """What is wrong with the stamps of a recording's samples; empty where nothing is."""
    period_s = float(np.median(np.diff(samples.stamps_s))) if samples is not None and len(samples) > 1 else 0.0
    return (
        f"IMU: one sample in {period_s:.3g} s (stamps in milliseconds or microseconds?)" if period_s > SLOWEST_S else ""
    )
