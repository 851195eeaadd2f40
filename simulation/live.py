"""A simulated world as a camera that the runtime drives: `sim:SEED`."""

from typing import Any

from edgemap.runtime.frames.camera import Camera, CameraInfo, CameraOptions
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.frame import Frame
from edgemap.simulation.record import truth_of
from edgemap.simulation.shots import shots
from edgemap.simulation.truth import object_records
from edgemap.simulation.world import CONTRACT_STAMPS_S, World, draw_world

RENDERERS = ("moderngl", "embreex", "PIL")  # what rendering needs of the extra `simulation`
SEED_DIGITS = 18


class SimCamera(Camera):
    """Renders a world's drive while it is read, a few pictures ahead. world: with all of its truth.

    Raises SimulationError.
    """

    def __init__(self, name: str, world: World) -> None:
        lens, mount, rate_hz = world.camera.intrinsics, world.camera.mount, world.camera.rate_hz
        size, count, truth = (lens.width, lens.height), world.frames, truth_of(world)
        super().__init__(CameraInfo(name, size, lens, mount, rate_hz=rate_hz, frame_count=count, truth=truth))
        self.world = world
        self._shots = shots(world, range(count))  # begins at the first `next`
        self._boxes: list[list[dict[str, Any]]] = []

    def read(self) -> Frame | None:
        """The next picture; None after the last. The first takes some seconds: the home is lit."""
        shot = next(self._shots, None)
        if shot is None:
            return None
        self._boxes.append(shot.boxes)
        return self.frame(
            shot.decoded(), shot.index / self.world.camera.rate_hz, f"{self.info.name} frame {shot.index}"
        )

    def object_records(self) -> list[dict[str, Any]]:
        """The true objects, as in objects.json, with the number of delivered pictures in which each is visible."""
        return object_records(self.world.apartment, self.world.poses()[0], self._boxes)

    def close(self) -> None:
        """Stop rendering and deliver nothing more."""
        self._shots.close()


def open(address: str, how: CameraOptions = CameraOptions()) -> SimCamera:  # noqa: B008
    """The camera `sim:SEED`, for the entry point of its kind: 450 pictures by default.

    Raises UsageError for a seed that is no number, and MissingExtraError where the extra is missing.
    """
    spec = f"sim:{address}"
    if not address.isdecimal() or len(address) > SEED_DIGITS:
        raise UsageError(f"camera {spec!r}: expected sim:SEED with a whole number, 0 or more")
    need("simulation", spec, RENDERERS)
    camera = SimCamera(spec, draw_world(int(address), how.frames or len(CONTRACT_STAMPS_S)))
    camera.update_info(intrinsics=how.intrinsics or camera.info.intrinsics, mount=how.mount or camera.info.mount)
    return camera


def found() -> list[tuple[str, str]]:
    """No device is searched for."""
    return []
