"""`edgemap run --map auto`: which of the named maps the robot is in, by objects and floor."""

from edgemap.geometry.errors import MapError
from edgemap.runtime.frames.reading import print_message
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.map_store import maps_folder
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import Relocaliser, SavedMap


def find_place(mapper: Mapper) -> Relocaliser:
    """Has the mapper find out in which named map it is. One that is damaged is reported and left out. Raises MapError
    where there is none."""
    saved = list[SavedMap]()
    for folder in sorted(path.parent for path in maps_folder().glob("*/map.json")):
        try:
            saved.append(SavedMap(*load_annotated_map(folder), load_grid(folder), folder))
        except MapError as error:
            print_message(f"--map auto: {error}: left out")
    if not saved:
        raise MapError(f"--map auto: no named map in {maps_folder()}; make one with --map NAME")
    finder = Relocaliser(saved, mapper.config)
    mapper.relocalise_by(finder)
    return finder
