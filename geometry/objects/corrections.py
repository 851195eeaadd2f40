"""Corrections of an object's class, position, size and yaw by a person, and objects that a person adds."""

import math
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.map_object import MapObject

PLACED_SIGMA_M = 0.05  # for a position that a person sets on a map: a finger's width at the usual zoom
SMALLEST_M, LARGEST_M = 0.02, 20.0  # limits of a size that a person sets
WORDS = ("label", "position", "size", "yaw")


@dataclass(frozen=True, slots=True)
class Correction:
    """Values that a person has set instead of the measured ones; None or empty if not set.

    place_m: (x, y), map frame. size_m: width, depth and height. yaw_rad: direction of the front. anchor_s: stamp of the
    pose that was nearest to the position when the person set it; the position moves with this pose. None in a map that
    was loaded.
    """

    label: str = ""
    place_m: tuple[float, float] | None = None
    size_m: tuple[float, float, float] | None = None
    yaw_rad: float | None = None
    anchor_s: float | None = None

    @classmethod
    def of(cls, item: MapObject) -> "Correction":
        """The correction that is stored in a saved object."""
        said = item.corrected
        return cls(
            item.label if "label" in said else "",
            _pair(item.position_m) if "position" in said else None,
            (item.width_m, item.depth_m or item.width_m, item.height_m) if "size" in said else None,
            item.yaw_rad if "yaw" in said else None,
        )

    def updated(self, newer: "Correction") -> "Correction":
        """This correction, with the fields replaced that a newer correction sets."""
        placed = newer if newer.place_m is not None else self
        return Correction(
            newer.label or self.label,
            placed.place_m,
            newer.size_m or self.size_m,
            self.yaw_rad if newer.yaw_rad is None else newer.yaw_rad,
            placed.anchor_s,
        )

    def apply(self, item: MapObject) -> MapObject:
        """The object, with its values replaced by those of the correction."""
        said = {
            "label": bool(self.label),
            "position": self.place_m is not None,
            "size": self.size_m is not None,
            "yaw": self.yaw_rad is not None,
        }
        item = replace(item, corrected=tuple(word for word in WORDS if said[word]))
        if self.label:
            item = replace(item, label=self.label, labels={self.label: 1.0})
        if self.place_m is not None:
            item = replace(item, position_m=np.array(self.place_m), covariance_m2=np.eye(2) * PLACED_SIGMA_M**2)
        if self.size_m is not None:
            width_m, depth_m, height_m = self.size_m
            item = replace(item, width_m=width_m, depth_m=depth_m, height_m=height_m)
        return item if self.yaw_rad is None else replace(item, yaw_rad=self.yaw_rad)


def fault_of(correction: Correction) -> str:
    """Why a correction is invalid, in one line; empty if it is valid."""
    size = correction.size_m
    if size is not None and not all(SMALLEST_M <= side <= LARGEST_M for side in size):
        given = " x ".join(f"{side:g}" for side in size)
        return f"a size is width, depth and height of {SMALLEST_M} to {LARGEST_M:g} m each, not {given} m"
    numbers = (*(correction.place_m or ()), correction.yaw_rad or 0.0)
    return "" if all(map(math.isfinite, numbers)) else "a position and a yaw are finite numbers"


def added_object(identity: str, correction: Correction, stamp_s: float) -> MapObject:
    """Creates an object that a person adds to the map. It has no sightings, and its confidence is 1."""
    item = MapObject(
        identity, correction.label, np.zeros(2), np.eye(2), 0.0, 0.0, 1, 1.0, stamp_s, stamp_s, confirmed=True
    )
    return correction.apply(item)


def _pair(place: np.ndarray) -> tuple[float, float]:
    x_m, y_m = place
    return float(x_m), float(y_m)
