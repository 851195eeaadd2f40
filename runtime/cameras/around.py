"""A camera round another one: what it delivers is read in another way, what it knows stays as it is."""

from typing import Any

from edgemap.runtime.cameras.base import CameraBase
from edgemap.runtime.cameras.fault import CameraState
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.frame import Frame


class CameraAround(CameraBase):
    """All that a camera knows, from a camera behind. Subclasses change `read`."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera.name, camera.intrinsics, camera.mount)
        self.live, self.size = camera.live, camera.size
        self.rate_hz, self.frame_count = camera.rate_hz, camera.frame_count
        self.truth, self.attitudes, self.wheel = camera.truth, camera.attitudes, camera.wheel
        self.decisions, self.edits = camera.decisions, camera.edits
        self._camera = camera

    @property
    def state(self) -> CameraState:
        """That of the camera behind."""
        return self._camera.state

    def read(self) -> Frame | None:
        """The next frame of the camera behind."""
        return self._camera.read()

    def object_records(self) -> list[dict[str, Any]] | None:
        """What the camera behind knows."""
        return self._camera.object_records()

    def close(self) -> None:
        """Close the camera behind."""
        self._camera.close()
