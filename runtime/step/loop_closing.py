"""Loop closure: landmarks observed again measure the drift of odometry, and correct trajectory and map."""

import math
from dataclasses import dataclass

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.loop_closure import Closure, LoopSearch
from edgemap.geometry.slam.pose_graph import PoseGraph, drop_keyframes
from edgemap.geometry.trajectory_correction import TrajectoryCorrection


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """A loop closure's result. pose_map_base: of this frame. past: correction of everything before it. moved_m:
    correction of this frame's pose. links: number of landmarks matched to earlier ones so far.
    """

    pose_map_base: SE2
    past: TrajectoryCorrection
    moved_m: float
    links: int


class LoopCloser:
    """Bounds the size of the map and closes loops in its graph every few keyframes, a unit of work in each frame.

    Counts frames, path and rotation, never time: the same frames give the same corrections. closes_loops: where not,
    it only bounds the size, and the pose is odometry's. accepted: number of landmarks matched to earlier ones so far.
    """

    def __init__(self, closes_loops: bool = True) -> None:
        self.closes_loops = closes_loops
        self.accepted = 0
        self._search: LoopSearch | None = None
        self._graph: PoseGraph | None = None
        self._work: Closure | None = None

    @property
    def busy(self) -> bool:
        """Whether work is under way."""
        return self._work is not None

    def begin(self, floor_map: FloorMap) -> None:
        """Starts the work that is due every few keyframes."""
        self._graph, self._work = floor_map.graph, self._units(floor_map)

    def step(self, graph: PoseGraph, now_s: float) -> LoopCorrection | None:
        """One unit of the work under way; the correction that it ends with. now_s: stamp of the latest frame."""
        if self._work is None or graph is not self._graph:  # of a map that was replaced
            self._work = None
            return None
        try:
            next(self._work)
            return None
        except StopIteration as end:
            self._work = None
            solved = end.value
        if solved is None:
            return None
        before = graph.trajectory.pose
        solution, covariances, relinked = solved
        past = graph.correct(solution, covariances, relinked, now_s)
        return None if past is None else self.correction(graph, before, past)

    def correction(self, graph: PoseGraph, before: SE2, past: TrajectoryCorrection) -> LoopCorrection:
        """A graph's correction as a step takes it. before: pose of this frame before it."""
        pose = graph.trajectory.pose
        moved_m = math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        return LoopCorrection(pose, past, moved_m, self.accepted)

    def _units(self, floor_map: FloorMap) -> Closure:
        floor_map.bound()
        yield
        drop_keyframes(floor_map.graph)
        yield
        if not self.closes_loops:
            return None
        if self._search is None or self._search.graph is not floor_map.graph:
            self._search = LoopSearch(floor_map.graph)
        solved = yield from self._search.closure()
        self.accepted = self._search.accepted
        return solved
