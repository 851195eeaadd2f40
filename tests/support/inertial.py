from edgemap.geometry.camera.attitude import Attitude
from edgemap.runtime.motion.attitude.inertial import InertialAttitude
from edgemap.runtime.motion.attitude.source import NODDING_RAD


class AboutMount(InertialAttitude):
    """Gyro and accelerometer beside the mount's attitude, which counts where there are no samples."""

    def __init__(self, mount, rule=None, sigma_rad=NODDING_RAD):
        super().__init__(mount, rule)
        self._level = Attitude.of_mount(mount, sigma_rad)

    def predict(self, frame, moved=None, other=None):
        return super().predict(frame, moved, other or self._level)

    @property
    def faults(self):
        return [self.fault] if self.fault else []
