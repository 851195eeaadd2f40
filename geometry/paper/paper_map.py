"""`--clustering paper`: single linkage per label at 1 m over all sightings (paper, section 3.7)."""

from collections import Counter

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject, SightingSums, id_order
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.paper.single_linkage import SingleLinkage

Root = tuple[int, int]


class _Cluster:
    """What is known of one cluster beside its place. number: of its id, None until it is given one."""

    def __init__(self) -> None:
        self.sums = SightingSums()
        self.covariance_sum = np.zeros((2, 2))
        self.number: int | None = None


class PaperMap:
    """The paper's objects: sightings of a label within the threshold of each other become one object. Neighbouring
    chairs merge (its section 4.5). An object's id is the oldest of those that merged into it; its covariance is the
    mean of its sightings', since the paper has none. Its clusters hold all sightings of a drive, so no object moves or
    is removed.
    """

    movable = False

    def __init__(self, threshold_m: float = 1.0) -> None:
        self._threshold_m = threshold_m
        self._linkage: dict[str, SingleLinkage] = {}
        self._clusters: dict[str, dict[Root, _Cluster]] = {}
        self._issued: Counter[str] = Counter()
        self.merged: dict[str, str] = {}

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Updates the map with one frame's sightings. Returns the id of each one's object."""
        return [self._add(placed) for placed in sightings]

    def objects(self) -> list[MapObject]:
        """One object per cluster, at the mean of its sightings."""
        found = []
        for label, linkage in self._linkage.items():
            for root, (position, count) in linkage.centres().items():
                cluster = self._clusters[label][root]
                identity = f"{label}-{cluster.number}"
                found.append(cluster.sums.as_object(identity, label, position, cluster.covariance_sum / count))
        return sorted(found, key=lambda item: id_order(item.id))

    def near(self, point_m: Array, reach_m: float) -> list[MapObject]:  # noqa: ARG002
        """Raises MapError: see `drop`."""
        raise MapError("the paper's clustering forgets nothing, so nobody asks what is near")

    def shown_as(self, identity: str) -> str:
        """The id itself: objects of two labels are never one."""
        return identity

    def moved(self) -> None:
        """Raises MapError: sightings stay where they were placed."""
        raise MapError("the paper's clustering keeps every sighting where it was placed: run it without loop closure")

    def set_presence(self, identity: str, probability: float) -> None:  # noqa: ARG002
        """Raises MapError: see `drop`."""
        self.drop(identity)

    def retilt(self, tilt_rad: Array) -> None:  # noqa: ARG002
        """Raises MapError: see `drop`."""
        self.drop("all")

    def scale(self, factor: float) -> None:  # noqa: ARG002
        """Raises MapError: see `drop`."""
        self.drop("all")

    def drop(self, identity: str) -> None:
        """Raises MapError: sightings are never removed."""
        raise MapError(f"{identity}: the paper's clustering keeps every sighting for good")

    def _add(self, placed: PlacedSighting) -> str:
        label = placed.label
        linkage = self._linkage.setdefault(label, SingleLinkage(self._threshold_m))
        clusters = self._clusters.setdefault(label, {})
        x_m, y_m = placed.position_map_m
        root = linkage.add(float(x_m), float(y_m))
        for kept, gone in linkage.joined:
            self._join(label, clusters, kept, gone)
        cluster = clusters.setdefault(root, _Cluster())
        cluster.sums.add(placed)
        cluster.covariance_sum += placed.covariance_m2 + placed.shared_m2 + placed.from_pose(placed.pose_covariance)
        if cluster.number is None:
            self._issued[label] += 1
            cluster.number = self._issued[label]
        return f"{label}-{cluster.number}"

    def _join(self, label: str, clusters: dict[Root, _Cluster], kept: Root, gone: Root) -> None:
        """One cluster takes in another; the older number stays. Either may be the new point's own, still empty."""
        into, other = clusters.setdefault(kept, _Cluster()), clusters.pop(gone, _Cluster())
        into.sums.join(other.sums)
        into.covariance_sum += other.covariance_sum
        numbers = sorted(number for number in (into.number, other.number) if number is not None)
        into.number = numbers[0] if numbers else None
        if len(numbers) == 2:
            old, new = (f"{label}-{number}" for number in (numbers[1], numbers[0]))
            self.merged = {key: new if value == old else value for key, value in self.merged.items()} | {old: new}
