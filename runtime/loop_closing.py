"""Loop closure: landmarks observed again tell how far odometry has drifted, and correct trajectory and map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.observation_pool import ObjectShift
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import TrajectoryCorrection
from edgemap.geometry.slam.pose_graph import DriveGraph, GraphRule
from edgemap.runtime.frame_observations import FrameObservations

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """Where everything is now. pose_map_base, pose_covariance: of this frame. past: how all before it moved. shifts:
    where what was observed of each landmark lies, by its number. moved_m: by which this frame's pose was off. links:
    how often a landmark was found to be one observed before, so far."""

    pose_map_base: SE2
    pose_covariance: Array
    past: TrajectoryCorrection
    shifts: dict[int, ObjectShift]
    moved_m: float
    links: int


class NoLoopClosure:
    """The pose is what odometry says."""

    closes_loops = False

    def observe(
        self,
        pose_map_base: SE2,  # noqa: ARG002
        pose_covariance: Array,  # noqa: ARG002
        observed: FrameObservations,
    ) -> tuple[LoopCorrection | None, list[int]]:
        """Nothing is corrected, and no landmark is known."""
        return None, [-1] * len(observed.sightings)

    def begin_in(self, prior: Sequence[MapObject]) -> None:
        """The next observation is the first in a map that holds these."""


class LoopCloser(NoLoopClosure):
    """Keeps the drive as a graph of poses and landmarks, and tries every few keyframes to close loops.

    Counts frames, path and rotation, never time: the same frames give the same corrections.
    """

    closes_loops = True

    def __init__(self, rule: GraphRule | None = None) -> None:
        self.graph = DriveGraph(rule)

    def observe(
        self, pose_map_base: SE2, pose_covariance: Array, observed: FrameObservations
    ) -> tuple[LoopCorrection | None, list[int]]:
        """Take in one frame: the pose that odometry came to, and what was seen from there. The correction, if any, and
        the landmark of each sighting."""
        graph, closure, motion = self.graph, None, observed.motion
        if len(graph.way) == 0:
            graph.way.begin(pose_map_base, pose_covariance, observed.stamp_s)
        elif graph.advance(motion.motion, motion.covariance, observed.stamp_s):
            closure = graph.revisit()
        landmarks = graph.things(graph.look(observed.sightings))
        if closure is None:
            return None, landmarks
        pose = graph.way.pose
        moved_m = math.hypot(pose.x_m - pose_map_base.x_m, pose.y_m - pose_map_base.y_m)
        return LoopCorrection(pose, closure.covariance, closure.past, closure.moves, moved_m, graph.links), landmarks

    def begin_in(self, prior: Sequence[MapObject]) -> None:
        """Begin again in a map that holds these; its objects are landmarks observed before."""
        self.graph = DriveGraph(self.graph.rule)
        self.graph.remember(prior)
