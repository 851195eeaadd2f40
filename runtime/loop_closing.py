"""Loop closure: landmarks observed again measure the drift of odometry, and correct trajectory and map."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import LandmarkCorrection, TrajectoryCorrection
from edgemap.geometry.slam.pose_graph import GraphRule, PoseGraph
from edgemap.runtime.frame_observations import FrameObservations


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """Where everything is now. pose_map_base, pose_covariance: of this frame. past: how all before it moved.
    moved_m: by which this frame's pose was off. links: how often a landmark was found to be one observed before, so
    far. landmarks: which tracks are one, and how far they moved."""

    pose_map_base: SE2
    pose_covariance: Array
    past: TrajectoryCorrection
    moved_m: float
    links: int
    landmarks: LandmarkCorrection = field(default_factory=LandmarkCorrection)


class NoLoopClosure:
    """The pose is what odometry says."""

    closes_loops = False

    def observe(
        self, _pose_map_base: SE2, _covariance: Array, observed: FrameObservations
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
        self.graph = PoseGraph(rule)

    def observe(
        self, pose_map_base: SE2, pose_covariance: Array, observed: FrameObservations
    ) -> tuple[LoopCorrection | None, list[int]]:
        """Take in one frame: the pose that odometry came to, and what was seen from there. The correction, if any, and
        the landmark of each sighting."""
        graph, past, motion = self.graph, None, observed.motion
        if len(graph.trajectory) == 0:
            graph.trajectory.begin(pose_map_base, pose_covariance, observed.stamp_s)
        else:
            graph.advance(motion.motion, motion.covariance, observed.stamp_s)
            past = graph.close_loops(observed.stamp_s)
        landmarks = [track.number for track in graph.observe(observed.sightings)]
        if past is None:
            return None, landmarks
        pose = graph.trajectory.pose
        moved_m = math.hypot(pose.x_m - pose_map_base.x_m, pose.y_m - pose_map_base.y_m)
        found = graph.landmarks()
        return LoopCorrection(pose, past.covariances[-1], past, moved_m, graph.links, found), landmarks

    def begin_in(self, prior: Sequence[MapObject]) -> None:
        """Begin again in a map that holds these; its objects are landmarks observed before."""
        self.graph = PoseGraph(self.graph.rule)
        self.graph.add_prior_landmarks(prior)
