"""Relocalises the robot in a saved map by its objects and its floor."""

from collections.abc import Generator, Sequence

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, Registration
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.config import Config

RETRY_AFTER = 50  # frames after which the same number of objects is worth another try


class Relocaliser:
    """Tries to align the map of this run with a saved one whenever it has grown, a bounded unit of work in each frame.

    saved: the saved map's objects as they were measured; edited: with their edits. run_map: the map to build until the
    alignment; its ids continue after the saved ones. annotations, grid: of the saved map, which have no pose in this
    run until then. alignment: None until then. reason: why there is none yet. guesses: poses in the saved map at which
    the run may have started (last pose, dock); they are tried first, and fewer objects confirm them.
    """

    def __init__(
        self,
        edited: Sequence[MapObject],
        config: Config,
        guesses: Sequence[SE2] = (),
        annotations: Annotations = NO_ANNOTATIONS,
        grid: OccupancyGrid | None = None,
    ) -> None:
        self.saved, self.edited = annotations.measured(edited), edited
        self.annotations, self.grid = annotations, grid
        ids = [item.id for item in (*self.saved, *annotations.vanished)]
        self.run_map: FloorMap = FloorMap(config.association, config.loop_closure, ids)
        self._registration, self._guesses = config.registration, tuple(guesses)
        self.alignment: Alignment | None = None
        self.reason = "no object seen yet"
        self._count = self._frames = 0
        self._work: Generator[None, None, Alignment] | None = None

    @property
    def searching(self) -> bool:
        """Whether the robot has yet to be relocalised in the saved map."""
        return bool(self.saved) and self.alignment is None

    def align(self) -> Alignment | None:
        """The alignment, in the one call that finds it; None before and after."""
        if self.alignment is not None or not self._is_due():
            return None
        if self._work is None:
            if self._guesses and (alignment := self._guessed()):
                return alignment
            self._work = self._search()
        try:
            next(self._work)
        except StopIteration as end:
            self._work, self.alignment = None, end.value
        except AlignmentError as error:
            self._work, self.reason = None, str(error)
        return self.alignment

    def _guessed(self) -> Alignment | None:
        try:
            self.alignment = self._compared().aligned_near(self._guesses)
        except AlignmentError as error:
            self.reason = str(error)
        return self.alignment

    def _search(self) -> Generator[None, None, Alignment]:
        """The alignment, a bounded unit of work at each step. Raises AlignmentError."""
        found = yield from self._compared().aligning()
        return self._as_it_is_now(found)

    def _as_it_is_now(self, alignment: Alignment) -> Alignment:
        """The map of this run has grown and moved since the work began. Raises AlignmentError."""
        return self._compared().realigned(alignment)

    def _compared(self) -> Registration:
        """Objects and grids of the saved map and of this run so far."""
        grids = self.grid, self.run_map.grid
        return Registration(self.saved, self.run_map.objects(), self._registration, grids)

    def _is_due(self) -> bool:
        """While a search is unfinished, and when there are more or better objects than at the last attempt."""
        self._frames += 1
        count = len(self.run_map.objects())
        if self._work is not None:
            return True
        if count <= self._count and self._frames < RETRY_AFTER:
            return False
        self._count, self._frames = count, 0
        return count > 0
