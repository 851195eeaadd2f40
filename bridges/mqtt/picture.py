"""The map as a picture without anything of the camera, drawn on a separate thread."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

from edgemap.geometry.grid.rooms import Room
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.rooms import room_at, rooms_of, title_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import png
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, map_picture
from edgemap.runtime.step.slam import StepResult

POSES = 400  # of the path, about


@dataclass(slots=True)
class MapPicture:
    """Draws the newest map whenever it has drawn the one before. send: takes each PNG, on the drawing thread."""

    send: Callable[[bytes], object]
    rooms: tuple[Room, ...] = ()
    _worker: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "map picture"))
    _drawing: Future[None] | None = None

    def draw(self, result: StepResult, objects: list[MapObject]) -> None:
        """Begins a drawing, unless one is under way. Raises what the last one raised."""
        if self._drawing is not None:
            if not self._drawing.done():
                return
            drawn, self._drawing = self._drawing, None
            drawn.result()
        self._drawing = self._worker.submit(self._draw, result, objects, result.trajectory.thinned(POSES)[1])

    def room(self, pose: SE2) -> str | None:
        """What a person calls the room of a pose, by the newest drawing; None where that is unknown."""
        room = room_at(self.rooms, (pose.x_m, pose.y_m))
        return room and title_of(room)

    def close(self) -> None:
        """Ends after the drawing that is under way."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _draw(self, result: StepResult, objects: list[MapObject], poses: list[SE2]) -> None:
        annotations, grid = result.annotations, result.grid
        self.rooms, doors = rooms_of(objects, annotations, grid)
        drawn = DrawnMap(objects, poses, (), (), annotations.zones, grid, self.rooms, doors)
        self.send(png(map_picture(drawn)))
