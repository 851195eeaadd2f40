"""The best source of a camera's attitude."""

from __future__ import annotations

from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.attitude.sources import MountAttitude, RecordedAttitude
from edgemap.runtime.cameras.protocol import Camera


def open_attitude(
    odometry: str, camera: Camera, mount: Mount, imu: bool = True, rule: AttitudeRule | None = None
) -> AttitudeSource:
    """The best source for this camera: recorded 6-DoF poses with `--odometry truth`, else the IMU's samples where
    frames bring any and `imu` allows it, else the mount."""
    if odometry == "truth" and camera.attitudes is not None:
        return RecordedAttitude(camera.attitudes, mount)
    rule = rule or AttitudeRule()
    still = MountAttitude(mount, rule.mount_sigma_rad)
    return InertialAttitude(mount, still, rule) if imu else still
