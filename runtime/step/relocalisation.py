"""Relocalises the robot in a saved map by its objects and its floor."""

from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, Registration
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.config import Config

RETRY_AFTER = 50  # frames after which the same number of objects is worth another try


@dataclass(frozen=True, eq=False)
class SavedMap:
    """A map that a run may continue. objects: with people's edits. grid: None without one. path: where it is saved,
    None of one that no file holds."""

    objects: Sequence[MapObject] = ()
    annotations: Annotations = NO_ANNOTATIONS
    grid: OccupancyGrid | None = None
    path: Path | None = None

    @cached_property
    def measured(self) -> list[MapObject]:
        """Its objects as they were measured, deleted ones included."""
        return self.annotations.measured(self.objects)

    @cached_property
    def ids(self) -> frozenset[str]:
        """The ids of these."""
        return frozenset(item.id for item in self.measured)


class Relocaliser:
    """Tries to align the map of this run with saved ones whenever it has grown, a bounded unit of work in each frame.
    The one that fits alone is the robot's place; chance is counted over all of them.

    saved: the one that this run continues, None until it is known. run_map: the map to build until the alignment; its
    ids continue after those of all saved maps. alignment: None until then. reason: why there is none yet. guesses:
    poses in a single saved map at which the run may have started (last pose, dock); they are tried first, and fewer
    objects confirm them.
    """

    def __init__(
        self, places: Sequence[SavedMap], config: Config, guesses: Sequence[SE2] = (), saved: SavedMap | None = None
    ) -> None:
        self.places, self.saved, self._guesses = places, saved, tuple(guesses)
        ids = [item.id for place in places for item in (*place.measured, *place.annotations.vanished)]
        self.run_map = FloorMap(config.association, config.loop_closure, ids)
        self._rule = replace(config.registration, chance=config.registration.chance / len(places))
        self.alignment: Alignment | None = None
        self.reason = "no object seen yet"
        self._count = self._frames = 0
        self._work: Generator[None, None, Alignment] | None = None

    def align(self) -> Alignment | None:
        """The alignment, in the one call that finds it; None before and after."""
        if self.alignment is not None or not self._is_due():
            return None
        self._work = self._work or self._search()
        try:
            next(self._work)
        except StopIteration as end:
            self._work, self.alignment = None, end.value
        except AlignmentError as error:
            self._work, self.reason = None, str(error)
        return self.alignment

    def _search(self) -> Generator[None, None, Alignment]:
        """The alignment, a bounded unit of work at each step. Raises AlignmentError."""
        fits, compared = list[tuple[SavedMap, Alignment]](), [self._compared(place) for place in self.places]
        if self._guesses:
            with suppress(AlignmentError):
                return compared[0].aligned_near(self._guesses)
        for place, registration in zip(self.places, compared, strict=True):
            yield
            try:
                fits.append((place, (yield from registration.aligning())))
            except AlignmentError as error:
                self.reason = f"{place.path.name}: {error}" if place.path else str(error)
        self._frames = 0  # the next comparison comes as long after this one's end
        if len(fits) != 1:
            both = " and ".join(place.path.name for place, _ in fits if place.path)
            raise AlignmentError(f"{both} both fit" if fits else self.reason)
        ((place, found),) = fits
        alignment = self._compared(place).realigned(found)  # this run's map has grown and moved since the work began
        self.saved = place
        return alignment

    def _compared(self, place: SavedMap) -> Registration:
        """A saved map and that of this run so far."""
        return Registration(place.measured, self.run_map.objects(), self._rule, (place.grid, self.run_map.grid))

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
