"""Loop closure: landmarks observed again measure the drift of odometry, and correct trajectory and map."""

from dataclasses import dataclass

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.slam.loop_closure import Closure, closure
from edgemap.geometry.trajectory_correction import TrajectoryCorrection


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """A loop closure's result. moved_m: correction of this frame's pose. links: number of landmarks matched to earlier
    ones so far."""

    moved_m: float
    links: int


class LoopCloser:
    """Bounds the size of the map and closes loops in its graph every few keyframes, a unit of work in each frame.

    Counts frames, path and rotation, never time: the same frames give the same corrections. closes_loops: where not,
    it only bounds the size, and the pose is odometry's.
    """

    def __init__(self, closes_loops: bool = True) -> None:
        self.closes_loops = closes_loops
        self._due = False
        self._map: FloorMap | None = None
        self._work: Closure | None = None

    def step(self, floor_map: FloorMap, is_keyframe: bool, now_s: float) -> tuple[bool, TrajectoryCorrection | None]:
        """One unit of the work under way. Returns whether it has ended, and the correction that it ends with.
        is_keyframe: whether the latest frame is one. now_s: its stamp."""
        self._due |= is_keyframe and len(floor_map.graph.trajectory) % floor_map.graph.rule.every == 0
        if self._due and self._work is None:
            self._due, self._map, self._work = False, floor_map, self._units(floor_map)
        if self._work is None:
            return False, None
        if floor_map is not self._map:  # which was replaced
            self._work = None
            return True, None
        try:
            next(self._work)
        except StopIteration as end:
            self._work = None
            return True, None if end.value is None else floor_map.graph.correct(*end.value, now_s=now_s)
        return False, None

    def _units(self, floor_map: FloorMap) -> Closure:
        floor_map.bound()
        yield
        floor_map.graph.drop_keyframes()
        yield
        return (yield from closure(floor_map.graph)) if self.closes_loops else None
