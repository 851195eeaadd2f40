"""How much floor an object takes, as far as its class and its apparent size tell; its heading is not known."""

from __future__ import annotations

import math

from edgemap.geometry.floor_map import MapObject
from edgemap.geometry.shapes import FOOTPRINT_M, WIDEST_UNKNOWN_M


def footprint_m(label: str, width_m: float) -> tuple[float, float]:
    """Width and depth in metres: the class's usual footprint, else a square as wide as it looks, 1 m at most."""
    unknown_m = min(width_m, WIDEST_UNKNOWN_M)
    return FOOTPRINT_M.get(label, (unknown_m, unknown_m))


def radius_m(item: MapObject) -> float:
    """Radius of the circle round an object's position that takes as much floor as its footprint does, m; at least 5 cm.

    A circle, because the way an object faces is not known: a couch sticks out of it at both ends, and fills it nowhere
    in front and behind.
    """
    width, depth = footprint_m(item.label, item.width_m)
    return max(math.sqrt(width * depth / math.pi), 0.05)
