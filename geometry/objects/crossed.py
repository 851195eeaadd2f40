"""Mapped furniture on the path of the base is no furniture, such as a carpet that was detected as a bed."""

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m

# What stays in its place, so that it does not matter when the base was there.
FIXTURES = frozenset({"bed", "couch", "dining table", "oven", "refrigerator", "toilet"})


def is_crossed(item: MapObject, path_m: Array, lens_m: float) -> bool:
    """Whether the base has been within an object's footprint, whatever the object's yaw.

    path_m: (N, 2), positions of the base, map frame. lens_m: height of the lens. False where the class is usually as
    high as the lens or higher, since a robot may pass under it, and for an object that a person has confirmed or
    corrected.
    """
    if item.label not in FIXTURES or HEIGHT_M[item.label][0] >= lens_m or item.confirmed or item.corrected:
        return False
    radius_m = min(footprint_m(item.label, item.width_m)) / 2.0
    return bool((np.square(path_m - item.position_m).sum(axis=1) < radius_m**2).any())
