"""Bounds the graph's size: old keyframes are dropped, and their observations move to nearby ones."""

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.pose_graph import PoseGraph
from edgemap.geometry.thinning import nearest_earlier


def drop_keyframes(graph: PoseGraph) -> None:
    """Drops those keyframes of the older half that are nearest to an earlier one, a radian counting as a metre. The
    first keyframes of a place remain, so later observations are relative to them. Observations move to the remaining
    keyframe.
    """
    trajectory = graph.trajectory
    excess, half = len(trajectory) - graph.rule.keyframes.maximum, len(trajectory) // 2
    if excess <= 0:
        return
    into = nearest_earlier(trajectory.vectors()[:half], excess)
    left = [row for row in range(len(trajectory)) if row not in into]
    onto: dict[int, tuple[int, SE2 | None]] = {row: (new, None) for new, row in enumerate(left)}
    for gone, kept in into.items():
        while kept in into:
            kept = into[kept]
        onto[gone] = onto[kept][0], trajectory.poses[kept].inverse() @ trajectory.poses[gone]
    trajectory.drop(into.keys())
    graph.place([landmark for landmark in graph.landmarks.all.values() if landmark.move_to(onto)])
