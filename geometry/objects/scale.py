"""A map at another scale: after a correction of the lens's height, or by one measured length."""

from collections.abc import Sequence
from dataclasses import replace

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject, placed_history
from edgemap.geometry.objects.annotations import Annotations, Corners


def scaled_map(
    objects: list[MapObject], annotations: Annotations, grid: OccupancyGrid | None, factor: float
) -> tuple[list[MapObject], Annotations, OccupancyGrid | None]:
    """Objects, annotations and grid with all lengths times `factor`, about the origin of the map; the same ones for 1.
    A size that a person has set stays."""
    if factor == 1.0:
        return objects, annotations, grid

    def scaled_points(points_m: Sequence[tuple[float, float]]) -> Corners:
        return tuple((factor * x_m, factor * y_m) for x_m, y_m in points_m)

    zones, rooms = (
        tuple(replace(area, corners_m=scaled_points(area.corners_m)) for area in areas)
        for areas in (annotations.zones, annotations.rooms)
    )
    ends = ((door, *scaled_points((door.from_m, door.to_m))) for door in annotations.doors)
    doors = tuple(replace(door, from_m=from_m, to_m=to_m) for door, from_m, to_m in ends)
    dock = annotations.dock and annotations.dock.scaled(factor)
    deleted = tuple(scaled_objects(annotations.deleted, factor))
    vanished = tuple(scaled_objects(annotations.vanished, factor))
    scaled = replace(annotations, zones=zones, rooms=rooms, doors=doors, deleted=deleted, dock=dock, vanished=vanished)
    return scaled_objects(objects, factor), scaled, grid and grid.scaled(factor)


def scaled_objects(objects: Sequence[MapObject], factor: float) -> list[MapObject]:
    """The objects with positions, sizes and standard deviations times `factor`, about the origin of the map. A size
    that a person has set stays."""
    return [_scaled(item, factor) for item in objects]


def _scaled(item: MapObject, factor: float) -> MapObject:
    views = tuple((factor * x_m, factor * y_m) for x_m, y_m in item.seen_from_m)
    history = placed_history(item.history, lambda point_m: factor * point_m)
    placed = replace(
        item, position_m=factor * item.position_m, covariance_m2=factor**2 * item.covariance_m2, seen_from_m=views,
        history=history, measured=item.measured and item.measured.scaled(factor),
    )  # fmt: skip
    if "size" in item.corrected:
        return placed
    return replace(placed, width_m=factor * item.width_m, height_m=factor * item.height_m)
