"""The map helps the pose: things seen again tell how far odometry has drifted, and way and map are put right by it."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.drive_graph import DriveGraph, GraphRule
from edgemap.geometry.floor_map import MapObject
from edgemap.geometry.keyframes import Rebase
from edgemap.geometry.se2 import SE2
from edgemap.geometry.sighting import Sighting
from edgemap.geometry.tracks import Track
from edgemap.runtime.odometry.protocol import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """Where everything is now. pose_map_base, pose_covariance: of this frame. past: how all before it moved. places:
    objects of the map by id, with position (2,) and the covariance (2, 2) that it has from the way. moved_m: by which
    this frame's pose was off. links: how often a thing was found to be one seen before, so far."""

    pose_map_base: SE2
    pose_covariance: Array
    past: Rebase
    places: dict[str, tuple[Array, Array]]
    moved_m: float
    links: int

    def moved(self, stamp_s: float, pose: SE2) -> SE2:
        """Where a pose of before is now."""
        return SE2(*self.past.poses([stamp_s], [pose.vector()])[0])


class NeverCorrects:
    """The pose is what odometry says."""

    corrects = False

    def look(
        self,
        pose_map_base: SE2,  # noqa: ARG002
        pose_covariance: Array,  # noqa: ARG002
        motion: Motion,  # noqa: ARG002
        sightings: Sequence[Sighting],  # noqa: ARG002
        stamp_s: float,  # noqa: ARG002
    ) -> Correction | None:
        """Nothing is corrected."""
        return None

    def named(self, object_ids: Sequence[str], merged: Mapping[str, str]) -> None:
        """Nothing is kept."""

    def remember(self, saved: Sequence[MapObject]) -> None:
        """Nothing is kept."""

    def relocated(
        self, pose_new_old: SE2, covariance: Array, saved: Sequence[MapObject], merged: Mapping[str, str]
    ) -> None:
        """Nothing is kept."""


class Corrector(NeverCorrects):
    """Keeps the drive as a graph of poses and things, and looks every few keyframes for things seen before.

    Counts frames, way and turn, never time: the same frames give the same corrections.
    """

    corrects = True

    def __init__(self, rule: GraphRule | None = None) -> None:
        self.graph = DriveGraph(rule)
        self._tracks: list[Track] = []
        self._merged: Mapping[str, str] = {}

    def look(
        self, pose_map_base: SE2, pose_covariance: Array, motion: Motion, sightings: Sequence[Sighting], stamp_s: float
    ) -> Correction | None:
        """Take in one frame: the pose that odometry came to by the motion, and what was seen from there."""
        graph, found = self.graph, None
        if len(graph.way) == 0:
            graph.way.begin(pose_map_base, pose_covariance, stamp_s)
        elif graph.advance(motion.motion, motion.covariance, stamp_s):
            found = graph.revisit()
        self._tracks = graph.look(sightings)
        if found is None:
            return None
        past, covariance = found
        pose = graph.way.pose
        moved_m = math.hypot(pose.x_m - pose_map_base.x_m, pose.y_m - pose_map_base.y_m)
        return Correction(pose, covariance, past, self._places(), moved_m, graph.links)

    def named(self, object_ids: Sequence[str], merged: Mapping[str, str]) -> None:
        """Which object of the map each sighting of the last `look` went to. merged: ids that are no more."""
        self._merged = merged
        for track, identity in zip(self._tracks, object_ids, strict=True):
            track.names[identity] += 1

    def remember(self, saved: Sequence[MapObject]) -> None:
        """Things of the map that the drive starts in."""
        self.graph.remember(saved)

    def relocated(
        self, pose_new_old: SE2, covariance: Array, saved: Sequence[MapObject], merged: Mapping[str, str]
    ) -> None:
        """The drive has found itself in a saved map. merged: what ids of this drive became there."""
        self._merged = merged
        self.graph.moved(pose_new_old, covariance)
        self.graph.remember(saved, merged)

    def _places(self) -> dict[str, tuple[Array, Array]]:
        """Each object of the map goes with the thing that most of its sightings are of."""
        groups = self.graph.groups()
        votes: defaultdict[str, Counter[int]] = defaultdict(Counter)
        for group, tracks in groups.items():
            for track in tracks:
                for name, count in track.names.items():
                    votes[self._merged.get(name, name)][group] += count
        places = {}
        for identity, counts in votes.items():
            thing = groups[max(counts, key=lambda group: (counts[group], -group))][0]
            places[identity] = thing.position_m, thing.spread_m2
        return places
