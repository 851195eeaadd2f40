"""The map helps the pose: things seen again tell how far odometry has drifted, and way and map are put right by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.observation_pool import ObjectShift
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import TrajectoryCorrection
from edgemap.geometry.slam.pose_graph import DriveGraph, GraphRule
from edgemap.runtime.odometry.protocol import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """Where everything is now. pose_map_base, pose_covariance: of this frame. past: how all before it moved. things:
    where what was seen of each thing lies, by its number. moved_m: by which this frame's pose was off. links: how often
    a thing was found to be one seen before, so far."""

    pose_map_base: SE2
    pose_covariance: Array
    past: TrajectoryCorrection
    things: dict[int, ObjectShift]
    moved_m: float
    links: int

    def moved(self, stamp_s: float, pose: SE2) -> SE2:
        """Where a pose of before is now."""
        return SE2(*self.past.poses([stamp_s], [pose.vector()])[0])


class NoLoopClosure:
    """The pose is what odometry says. things: of the sightings of the last `look`, the number of each one's thing."""

    corrects = False

    def __init__(self) -> None:
        self.things: list[int] = []

    def look(
        self,
        pose_map_base: SE2,  # noqa: ARG002
        pose_covariance: Array,  # noqa: ARG002
        motion: Motion,  # noqa: ARG002
        sightings: Sequence[Sighting],
        stamp_s: float,  # noqa: ARG002
    ) -> LoopCorrection | None:
        """Nothing is corrected, and no thing is known."""
        self.things = [-1] * len(sightings)
        return None

    def begin_in(self, known: Sequence[MapObject]) -> None:
        """The next look is the first in a map that holds these."""


class LoopCloser(NoLoopClosure):
    """Keeps the drive as a graph of poses and things, and looks every few keyframes for things seen before.

    Counts frames, way and turn, never time: the same frames give the same corrections.
    """

    corrects = True

    def __init__(self, rule: GraphRule | None = None) -> None:
        super().__init__()
        self.graph = DriveGraph(rule)

    def look(
        self, pose_map_base: SE2, pose_covariance: Array, motion: Motion, sightings: Sequence[Sighting], stamp_s: float
    ) -> LoopCorrection | None:
        """Take in one frame: the pose that odometry came to by the motion, and what was seen from there."""
        graph, found = self.graph, None
        if len(graph.way) == 0:
            graph.way.begin(pose_map_base, pose_covariance, stamp_s)
        elif graph.advance(motion.motion, motion.covariance, stamp_s):
            found = graph.revisit()
        self.things = graph.things(graph.look(sightings))
        if found is None:
            return None
        pose = graph.way.pose
        moved_m = math.hypot(pose.x_m - pose_map_base.x_m, pose.y_m - pose_map_base.y_m)
        return LoopCorrection(pose, found.covariance, found.past, found.moves, moved_m, graph.links)

    def begin_in(self, known: Sequence[MapObject]) -> None:
        """Start anew in a map that holds these; its objects are things seen before."""
        self.graph = DriveGraph(self.graph.rule)
        self.graph.remember(known)
