"""Floor area of an object by its class and its apparent size; its heading is unknown."""

import math

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.class_extents import footprint_m


def radius_m(item: MapObject) -> float:
    """Radius of the circle round an object's position that takes as much floor as its footprint does, m; at least 5 cm.

    A circle, because the way an object faces is not known: a couch sticks out of it at both ends, and fills it nowhere
    in front and behind.
    """
    width, depth = footprint_m(item.label, item.width_m)
    return max(math.sqrt(width * depth / math.pi), 0.05)
