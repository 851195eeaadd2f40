"""An IMU on a level robot without errors, and its filter beside the mount's attitude."""

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.carried import CarriedRule
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.motion.attitude.imu_trust import ImuTrust
from edgemap.runtime.motion.attitude.inertial import AttitudeRule, InertialAttitude
from edgemap.runtime.motion.attitude.source import NODDING_RAD
from edgemap.runtime.motion.trust import TrustRule

MOUNT, RULE = Mount.from_degrees(0.5, 10.0), AttitudeRule()


def level_samples(stamps_s, yaw_rad_s=0.0, force_m_s2=(0.0, 0.0, 9.81), mount=MOUNT):
    """Rate about the vertical and force by base axes: of each stamp, or the same at all."""
    rates, forces = np.zeros((2, len(stamps_s), 3))
    rates[:, 2], forces[:] = yaw_rad_s, force_m_s2
    base_optical = mount.rotation_base_optical()
    return ImuSamples(np.asarray(stamps_s), rates @ base_optical, forces @ base_optical)


class AboutMount(InertialAttitude):
    """Gyro and accelerometer beside the mount's attitude, which counts where there are no samples."""

    def __init__(self, mount, rule=RULE, sigma_rad=NODDING_RAD):
        super().__init__(mount, rule, CarriedRule(), ImuTrust(rule.noise.rest_window_s, TrustRule()))
        self._level = Attitude.of_mount(mount, sigma_rad)

    def predict(self, frame, moved=None, other=None):
        return super().predict(frame, moved, other or self._level)

    @property
    def faults(self):
        return [self.fault] if self.fault else []
