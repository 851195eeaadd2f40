"""`edgemap run --map auto`: which of the named maps the robot is in, by objects and floor."""

from edgemap.geometry.errors import MapError
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.map_store import maps_folder
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import Relocaliser, SavedMap


def find_place(mapper: Mapper) -> Relocaliser:
    """Has the mapper find out in which named map it is. Raises MapError where there is none, or one is damaged."""
    folders = sorted(path.parent for path in maps_folder().glob("*/map.json"))
    if not folders:
        raise MapError(f"--map auto: no named map in {maps_folder()}; make one with --map NAME")
    finder = Relocaliser([SavedMap(*load_annotated_map(one), load_grid(one), one) for one in folders], mapper.config)
    mapper.relocalise_by(finder)
    return finder
