"""`edgemap run --map auto`: which of the named maps the robot is in, by objects and floor."""

from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.events import MapEvents
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.registration.alignment import Alignment, AlignmentError
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.map_store import maps_folder
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import Relocaliser


class PlaceFinder(Relocaliser):
    """As a Relocaliser, for several saved maps: all are compared with this run's whenever that has grown, and the one
    that fits alone is the place. Chance is counted over all of them.

    found: called with the map of the place before it is joined. path: its folder, None until then.
    """

    def __init__(self, folders: list[Path], config: Config, found: Callable[[Relocaliser], None]) -> None:
        super().__init__([], config)
        self._folders, self._found, self.path = folders, found, None
        self._maps: list[Relocaliser] = []
        for folder in folders:
            objects, annotations = load_annotated_map(folder)
            self._maps.append(Relocaliser(objects, config, annotations=annotations, grid=load_grid(folder)))
        ids = [item.id for place in self._maps for item in (*place.saved, *place.annotations.vanished)]
        self.run_map = FloorMap(config.association, config.loop_closure, ids)
        rule = replace(config.registration, chance=config.registration.chance / max(len(folders), 1))
        for place in self._maps:
            place.run_map, place._registration = self.run_map, rule

    @property
    def zones(self) -> list[Zone]:
        """All maps' zones, whose ids are not used again."""
        return [zone for place in self._maps for zone in place.annotations.zones]

    @property
    def searching(self) -> bool:
        """Whether the place is not known yet."""
        return self.alignment is None

    def _search(self) -> Generator[None, None, Alignment]:
        """The alignment with the one map that is accepted."""
        fits, compared = dict[int, Alignment](), [place._compared() for place in self._maps]
        for number, registration in enumerate(compared):
            yield
            try:
                fits[number] = yield from registration.aligning()
            except AlignmentError as error:
                self.reason = f"{self._folders[number].name}: {error}"
        self._frames = 0  # the next comparison comes as long after this one's end
        if len(fits) != 1:
            both = " and ".join(self._folders[number].name for number in fits)
            raise AlignmentError(f"{both} both fit" if fits else self.reason)
        ((number, found),) = fits.items()
        place = self._maps[number]
        alignment = place._as_it_is_now(found)
        self.saved, self.annotations, self.grid = place.saved, place.annotations, place.grid
        self.edited, self.path = place.edited, self._folders[number]
        self._found(self)
        return alignment


def find_place(mapper: Mapper) -> PlaceFinder:
    """Has the mapper find out in which named map it is. Raises MapError where there is none, or one is damaged."""
    folders = sorted(path.parent for path in maps_folder().glob("*/map.json"))
    if not folders:
        raise MapError(f"--map auto: no named map in {maps_folder()}; make one with --map NAME")
    finder = PlaceFinder(folders, mapper.config, mapper.enter_place)
    mapper.relocaliser, mapper.map, mapper.edits = finder, finder.run_map, MapEvents.after(finder.zones)
    return finder
