"""Queries on a map: nearest objects, objects inside a polygon, changes since a time."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.rooms import inside
from edgemap.geometry.map_object import MapEvent, MapObject


def nearest(
    objects: Sequence[MapObject], point_m: ArrayLike, label: str | None = None, count: int | None = None
) -> list[tuple[float, MapObject]]:
    """Objects with their distance in metres from a point (2,) of the map frame, nearest first, at most `count`.

    Equal distances keep their order. Raises MapError for a point that is not two finite numbers.
    """
    point = np.asarray(point_m, dtype=np.float64)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise MapError(f"nearest: the point must be two finite numbers, x and y in metres, not {point_m!r}")
    chosen = [item for item in objects if label in (None, item.label)]
    pairs = [(float(np.linalg.norm(item.position_m - point)), item) for item in chosen]
    return sorted(pairs, key=lambda pair: pair[0])[:count]


def inside_polygon(objects: Sequence[MapObject], corners_m: ArrayLike) -> list[MapObject]:
    """The objects whose centre lies inside a polygon, in their order.

    corners_m: (N, 2), N >= 3, map frame, either way round, not closed; sides that cross follow the even-odd rule.
    Raises MapError for anything else.
    """
    corners = np.asarray(corners_m, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise MapError("inside_polygon: needs three corners or more, each two finite numbers, x and y in metres")
    points = np.array([item.position_m for item in objects]).reshape(-1, 2)
    return [item for item, is_in in zip(objects, inside(corners, points), strict=True) if is_in]


def changes(objects: Sequence[MapObject], since_utc: float | None = None) -> list[tuple[MapObject, MapEvent]]:
    """The entries of all histories, by time; those of an unknown time first. since_utc: seconds since 1970; then only
    those at or after it, and none of an unknown time. objects: those that have vanished too, where they are wanted."""
    pairs = [(item, event) for item in objects for event in item.history]
    if since_utc is not None:
        pairs = [(item, event) for item, event in pairs if event.at is not None and event.at >= since_utc]
    return sorted(pairs, key=lambda pair: -math.inf if pair[1].at is None else pair[1].at)
