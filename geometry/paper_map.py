"""`--clustering paper`: single linkage per label at 1 m over all sightings (paper, section 3.7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.floor_map import MapObject, SightingSums, id_order
from edgemap.geometry.sighting import PlacedSighting
from edgemap.geometry.single_linkage import SingleLinkage

Array = NDArray[np.float64]
Cell = tuple[int, int]


class PaperMap:
    """Objects as the paper makes them: whatever lies within the threshold of its like becomes one object.

    Neighbouring chairs merge (its section 4.5). An object's id is the oldest of those that merged into it; its
    covariance is the mean of its sightings', since the paper has none.
    """

    def __init__(self, threshold_m: float = 1.0) -> None:
        self._threshold_m = threshold_m
        self._linkage: dict[str, SingleLinkage] = {}
        self._sums: dict[tuple[str, Cell], SightingSums] = {}
        self._covariance: dict[tuple[str, Cell], Array] = {}
        self._number: dict[tuple[str, Cell], int] = {}
        self._issued: dict[str, int] = {}
        self.merged: dict[str, str] = {}

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in one frame's sightings; the id of each one's object."""
        return [self._add(placed) for placed in sightings]

    def _add(self, placed: PlacedSighting) -> str:
        label = placed.label
        linkage = self._linkage.setdefault(label, SingleLinkage(self._threshold_m))
        x_m, y_m = placed.position_map_m
        cell = linkage.add(float(x_m), float(y_m))
        key = (label, cell)
        if key not in self._sums:
            self._sums[key] = SightingSums()
            self._covariance[key] = np.zeros((2, 2))
        self._sums[key].add(placed)
        self._covariance[key] += placed.covariance_m2 + placed.shared_m2 + placed.from_pose(placed.pose_covariance)
        return f"{label}-{self._number_of(label, linkage, cell)}"

    def _number_of(self, label: str, linkage: SingleLinkage, cell: Cell) -> int:
        """The cluster's number: the smallest that any of its cells was given, a new one where none was."""
        root = linkage.cluster_of(cell)
        own = [n for (of, key), n in self._number.items() if of == label and linkage.cluster_of(key) == root]
        if not own:
            self._issued[label] = self._issued.get(label, 0) + 1
            own = [self._issued[label]]
        self._number[label, cell] = kept = min(own)
        for number in set(own) - {kept}:
            self.merged[f"{label}-{number}"] = f"{label}-{kept}"
        return kept

    def objects(self) -> list[MapObject]:
        """One object per cluster, at the mean of its sightings."""
        found = []
        for label, linkage in self._linkage.items():
            for root, (position, count) in linkage.centres().items():
                sums, covariance = SightingSums(), np.zeros((2, 2))
                cells = [key for of, key in self._sums if of == label and linkage.cluster_of(key) == root]
                for cell in cells:
                    sums.join(self._sums[label, cell])
                    covariance += self._covariance[label, cell] / count
                number = self._number_of(label, linkage, cells[0])
                found.append(sums.as_object(f"{label}-{number}", label, position, covariance))
        return sorted(found, key=lambda item: id_order(item.id))
