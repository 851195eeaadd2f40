"""Whether three values a frame are enough: the integrated planar motions against the full six-dimensional poses."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.trajectory import integrated, segment_errors
from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]


def planar_fit(poses: Array, lengths_m: Sequence[float]) -> dict[str, float | None]:
    """Deviation of the trajectory integrated from three values of each motion from the full poses.

    poses: (N, 4, 4) in a z-up frame, x forward and y left. The three are the two translations and the yaw of each
    motion in the moving frame, as the paper (§3.2) selects them from KITTI. mean_m, max_m: horizontal distance over
    the poses; mean_percent: of the way in space; t_rel_percent, r_rel_deg_per_m: means over all segments of the
    lengths, null where none fits. height_mean_m, height_max_m: the height above the start that is left out.
    """
    steps = [np.linalg.solve(before, after) for before, after in pairwise(poses)]
    above, moved = (
        [SE2(pose[0, 3], pose[1, 3], math.atan2(pose[1, 0], pose[0, 0])) for pose in several]
        for several in (poses, steps)
    )
    selected = [above[0] @ pose for pose in integrated(moved)]
    places, heights_m = poses[:, :2, 3], np.abs(poses[:, 2, 3] - poses[0, 2, 3])
    apart_m = np.linalg.norm(places - [(pose.x_m, pose.y_m) for pose in selected], axis=1)
    way_m = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    relative = np.vstack([segment_errors(above, selected, length) / length for length in lengths_m])
    shift, turn = relative.mean(axis=0) if len(relative) else (None, None)
    return {
        "mean_m": float(apart_m.mean()),
        "max_m": float(apart_m.max()),
        "mean_percent": 100.0 * float(apart_m.mean()) / way_m if way_m else 0.0,
        "t_rel_percent": None if shift is None else 100.0 * float(shift),
        "r_rel_deg_per_m": None if turn is None else math.degrees(turn),
        "height_mean_m": float(heights_m.mean()),
        "height_max_m": float(heights_m.max()),
    }
