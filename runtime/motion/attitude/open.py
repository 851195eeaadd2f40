"""The best source of a camera's attitude."""

import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.motion.attitude.checked_mount import CheckedMount
from edgemap.runtime.motion.attitude.depth import DepthAttitude
from edgemap.runtime.motion.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.runtime.motion.attitude.protocol import AttitudeSource
from edgemap.runtime.motion.attitude.sources import RecordedAttitude
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.odometry import OdometryRules

SLOWEST_S = 0.75  # between two samples; a slower IMU is none


def open_attitude(
    odometry: str,
    camera: Camera,
    floor: FloorCamera,
    imu: bool = True,
    rule: AttitudeRule | None = None,
    health: HealthRule | None = None,
    rules: OdometryRules | None = None,
) -> AttitudeSource:
    """The best source for this camera: recorded 6-DoF poses with `--odometry truth`, else the IMU's samples where
    frames bring any and `imu` allows it, else the pictures; either about a mount that the room's edges check. Where a
    frame brings depth, the floor in it gives attitude and height. health: by which a picture shows another view. rules:
    by which a camera counts as carried, and a source's yaw as wrong."""
    if odometry == "truth" and camera.info.attitudes is not None:
        return RecordedAttitude(camera.info.attitudes, floor.mount)
    rule, rules = rule or AttitudeRule(), rules or OdometryRules()
    pictures = PicturesAttitude(floor.mount, rule.check.tilt, rule.rotation_share)
    clock = _clock_of(camera.info.imu)
    inertial = InertialAttitude(floor.mount, pictures, rule, rules.pictures.carried, rules.hybrid.trust, clock)
    without_depth = inertial if imu else pictures
    return CheckedMount(floor, DepthAttitude(floor, without_depth, pictures), pictures, rule.check, health)


def _clock_of(samples: ImuSamples | None) -> str:
    """What is wrong with the stamps of a recording's samples; empty where nothing is."""
    period_s = float(np.median(np.diff(samples.stamps_s))) if samples is not None and len(samples) > 1 else 0.0
    return (
        f"IMU: one sample in {period_s:.3g} s (stamps in milliseconds or microseconds?)" if period_s > SLOWEST_S else ""
    )
