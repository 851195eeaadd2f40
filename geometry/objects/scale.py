"""A map at another scale: what a measured length makes of a map that a camera alone measured."""

from collections.abc import Sequence
from dataclasses import replace

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations, Zone


def scaled_objects(objects: Sequence[MapObject], factor: float) -> list[MapObject]:
    """The objects with positions, sizes and standard deviations times `factor`, about the origin of the map. A size
    that a person has set stays."""
    return [_scaled(item, factor) for item in objects]


def _scaled(item: MapObject, factor: float) -> MapObject:
    views = tuple((factor * x_m, factor * y_m) for x_m, y_m in item.seen_from_m)
    placed = replace(
        item, position_m=factor * item.position_m, covariance_m2=factor**2 * item.covariance_m2, seen_from_m=views
    )
    if "size" in item.corrected:
        return placed
    return replace(placed, width_m=factor * item.width_m, height_m=factor * item.height_m)


def scaled_annotations(annotations: Annotations, factor: float) -> Annotations:
    """Zones, deleted objects and dock, scaled as the objects are."""
    return Annotations(
        tuple(
            Zone(zone.id, zone.name, tuple((factor * x_m, factor * y_m) for x_m, y_m in zone.corners_m))
            for zone in annotations.zones
        ),
        tuple(scaled_objects(annotations.deleted, factor)),
        None if annotations.dock is None else annotations.dock.scaled(factor),
    )
