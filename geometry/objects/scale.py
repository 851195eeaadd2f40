"""A map at another scale: after a correction of the lens's height, or by one measured length."""

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.se2 import SE2


def scaled_map(
    objects: list[MapObject], annotations: Annotations, grid: OccupancyGrid | None, factor: float
) -> tuple[list[MapObject], Annotations, OccupancyGrid | None]:
    """Objects, annotations and grid with all lengths times `factor`, about the origin of the map; the same ones for 1.
    A size that a person has set stays."""
    if factor == 1.0:
        return objects, annotations, grid
    return scaled_objects(objects, factor), annotations.transformed(SE2(), factor), grid and grid.scaled(factor)


def scaled_objects(objects: list[MapObject], factor: float) -> list[MapObject]:
    """The objects alone, as `scaled_map`."""
    return [item.transformed(SE2(), factor) for item in objects]
