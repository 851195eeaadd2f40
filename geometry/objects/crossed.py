"""Rejects furniture that the base has driven through, such as a carpet that was detected as a bed."""

import numpy as np

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.slam.keyframes import KeyframeTrajectory

# What stays in its place, so that it does not matter when the base was there.
FIXTURES = frozenset({"bed", "couch", "dining table", "oven", "refrigerator", "toilet"})


def is_crossed(item: MapObject, path: KeyframeTrajectory, lens_m: float) -> bool:
    """Whether the base has been inside an object's footprint at any yaw of the object, by more than the standard
    deviation of their distance (both covariances).

    lens_m: height of the lens. False where the class is usually as high as the lens or higher, since a robot may pass
    under it, and for an object that a person has confirmed or corrected.
    """
    if item.label not in FIXTURES or HEIGHT_M[item.label][0] >= lens_m or item.confirmed or item.corrected:
        return False
    radius_m = min(footprint_m(item.label, item.width_m)) / 2.0
    x_m, y_m = (path.vectors()[:, :2] - item.position_m).T
    inside_m = radius_m - np.hypot(x_m, y_m)
    rows = np.flatnonzero(inside_m > 0.0)
    if not len(rows):
        return False
    angle_rad = np.arctan2(y_m[rows], x_m[rows])
    outwards = np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    both_m2 = item.covariance_m2 + np.array([path.covariances[row][:2, :2] for row in rows.tolist()])
    variance_m2 = np.einsum("ni,nij,nj->n", outwards, both_m2, outwards)
    return bool((np.square(inside_m[rows]) > variance_m2).any())
