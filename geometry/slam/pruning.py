"""Bounds the graph's size: old keyframes are dropped, and their observations move to nearby ones."""

import numpy as np

from edgemap.geometry.slam.pose_graph import PoseGraph


def drop_keyframes(graph: PoseGraph) -> None:
    """Drops those keyframes of the older half that are nearest to an earlier one, a radian counting as a metre. The
    first keyframes of a place remain, so later observations are relative to them. Observations move to the remaining
    keyframe.
    """
    trajectory = graph.trajectory
    excess, half = len(trajectory) - graph.rule.keyframes.maximum, len(trajectory) // 2
    if excess <= 0:
        return
    poses = trajectory.vectors()[:half]
    apart = poses[:, None] - poses[None]
    apart[..., 2] = np.angle(np.exp(1j * apart[..., 2]))
    distance = np.linalg.norm(apart, axis=2)
    distance[np.triu_indices(half)] = np.inf  # to earlier ones only
    into = {row: row for row in range(len(trajectory))}
    for _ in range(excess):
        gone, kept = divmod(int(distance.argmin()), half)
        distance[gone] = distance[:, gone] = np.inf
        into[gone] = kept
    dropped, onto = {row for row, kept in into.items() if kept != row}, {}
    for row, kept in into.items():
        while into[kept] != kept:
            kept = into[kept]
        relative = trajectory.poses[kept].inverse() @ trajectory.poses[row]
        onto[row] = kept - sum(other < kept for other in dropped), relative if row != kept else None
    trajectory.drop(dropped)
    for landmark in graph.landmarks.all.values():
        landmark.rebase(onto)
    graph.place(list(graph.landmarks.all.values()))
