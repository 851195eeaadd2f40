"""The live RealSense driver on a recording."""

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.cameras.realsense import RealSenseDriver


class Playback(RealSenseDriver):
    """The driver with a recording in place of a device."""

    def __init__(self, path):
        super().__init__("realsense")
        self.path, self.broken = path, 0

    def config(self):
        if self.broken:
            self.broken -= 1
            raise CameraError("no RealSense device found")
        config = self._rs.config()
        config.enable_device_from_file(str(self.path), repeat_playback=False)
        return config

    def plug_in(self):
        """As where a device comes to the bus."""
        self._context.load_device(str(self.path))
