"""The best source of a camera's attitude."""

from __future__ import annotations

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.attitude.checked_mount import CheckedMount
from edgemap.runtime.attitude.depth import DepthAttitude
from edgemap.runtime.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.attitude.pictures import PicturesAttitude
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.attitude.sources import RecordedAttitude
from edgemap.runtime.cameras.protocol import Camera


def open_attitude(
    odometry: str, camera: Camera, floor: FloorCamera, imu: bool = True, rule: AttitudeRule | None = None
) -> AttitudeSource:
    """The best source for this camera: recorded 6-DoF poses with `--odometry truth`, else the IMU's samples where
    frames bring any and `imu` allows it, else the pictures; either about a mount that the room's edges check. Where a
    frame brings depth, the floor in it gives attitude and height."""
    if odometry == "truth" and camera.attitudes is not None:
        return RecordedAttitude(camera.attitudes, floor.mount)
    rule = rule or AttitudeRule()
    pictures = PicturesAttitude(floor.mount, rule.pictures)
    known = InertialAttitude(floor.mount, pictures, rule) if imu else pictures
    return CheckedMount(floor, DepthAttitude(floor, known), pictures, rule.check)
