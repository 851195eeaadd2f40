"""Loop closure: landmarks observed again measure the drift of odometry, and correct trajectory and map."""

import math
from dataclasses import dataclass

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.loop_closure import LoopSearch
from edgemap.geometry.slam.pose_graph import PoseGraph
from edgemap.geometry.trajectory_correction import TrajectoryCorrection


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """A loop closure's result. pose_map_base, pose_covariance: of this frame. past: correction of everything before it.
    moved_m: correction of this frame's pose. links: number of landmarks matched to earlier ones so far.
    """

    pose_map_base: SE2
    pose_covariance: Array
    past: TrajectoryCorrection
    moved_m: float
    links: int


class NoLoopClosure:
    """The pose is odometry's."""

    closes_loops = False
    busy = False

    def begin(self, graph: PoseGraph) -> None:
        """Does nothing."""

    def step(self, graph: PoseGraph, now_s: float) -> LoopCorrection | None:  # noqa: ARG002
        """Returns no correction."""
        return None


class LoopCloser(NoLoopClosure):
    """Tries every few keyframes to close loops in the map's graph, a bounded unit of work in each frame.

    Counts frames, path and rotation, never time: the same frames give the same corrections. found: number of landmarks
    matched to earlier ones so far.
    """

    closes_loops = True

    def __init__(self) -> None:
        self.found = 0
        self._search: LoopSearch | None = None

    @property
    def busy(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether a closure is under way: until it ends, no landmark and no keyframe leaves the graph."""
        return self._search is not None and self._search.busy

    def begin(self, graph: PoseGraph) -> None:
        """Starts a search for loops in the current graph."""
        if self._search is None or self._search.graph is not graph:
            self._search = LoopSearch(graph)
        self._search.begin()

    def step(self, graph: PoseGraph, now_s: float) -> LoopCorrection | None:
        """One unit of work on the closure under way; the correction that it ends with."""
        if self._search is None or self._search.graph is not graph:
            return None
        before = graph.trajectory.pose
        past = self._search.step(now_s)
        if past is None:
            return None
        self.found, pose = self._search.found, graph.trajectory.pose
        moved_m = math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        return LoopCorrection(pose, past.covariances[-1], past, moved_m, self.found)
