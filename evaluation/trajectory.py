"""How true an odometry is: KITTI's segment drift, absolute error, per-frame errors, honest covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.planar import fit_se2
from edgemap.geometry.se2 import SE2, wrap_angle

Array = NDArray[np.float64]

INDOOR_LENGTHS_M = (1.0, 2.0, 5.0)
KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
SEGMENT_STEP = 10  # frames between the starts of two segments, as KITTI has it


def path_m(poses: Sequence[SE2]) -> Array:
    """Way gone until each pose, metres, (N,), starting at zero."""
    places = np.array([(pose.x_m, pose.y_m) for pose in poses]).reshape(-1, 2)
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])


def motions(poses: Sequence[SE2]) -> list[SE2]:
    """The motion of the base from each pose to the next, one fewer than poses."""
    return [before.inverse() @ after for before, after in pairwise(poses)]


def integrated(steps: Sequence[SE2]) -> list[SE2]:
    """Poses that motions lead to, the identity first: one more than motions."""
    poses = [SE2()]
    for step in steps:
        poses.append(poses[-1] @ step)
    return poses


def segment_drift(
    true: Sequence[SE2], estimated: Sequence[SE2], length_m: float, step: int = SEGMENT_STEP
) -> tuple[float, float] | None:
    """Mean drift over all segments of one length: percent of the way, and degrees per metre; None where none fits.

    KITTI odometry protocol (Geiger, Lenz and Urtasun 2012): a segment starts every `step` frames and ends at the
    first frame whose true way from there exceeds the length; no alignment beyond the common start.
    """
    _same_length(true, estimated)
    way_m = path_m(true)
    shifts, turns = [], []
    for start in range(0, len(true), step):
        end = int(np.searchsorted(way_m, way_m[start] + length_m, side="right"))
        if end >= len(true):
            break
        wanted, found = true[start].inverse() @ true[end], estimated[start].inverse() @ estimated[end]
        error = found.inverse() @ wanted
        shifts.append(math.hypot(error.x_m, error.y_m))
        turns.append(abs(error.yaw_rad))
    if not shifts:
        return None
    return 100.0 * float(np.mean(shifts)) / length_m, math.degrees(float(np.mean(turns))) / length_m


def absolute_error_m(true: Sequence[SE2], estimated: Sequence[SE2]) -> float:
    """RMSE of the positions after the best rigid alignment: the absolute trajectory error of Sturm et al. (2012)."""
    _same_length(true, estimated)
    wanted, found = (np.array([(pose.x_m, pose.y_m) for pose in poses]) for poses in (true, estimated))
    aligned = fit_se2(found, wanted, np.ones(len(found))).apply(found)
    return float(np.sqrt(((aligned - wanted) ** 2).sum(axis=1).mean()))


def motion_errors(true: Sequence[SE2], estimated: Sequence[SE2]) -> Array:
    """Estimated less true motion of each frame: (N, 3) forward m, left m, yaw rad, in the previous base frame."""
    _same_length(true, estimated)
    differences = np.array([f.vector() - t.vector() for t, f in zip(true, estimated, strict=True)]).reshape(-1, 3)
    differences[:, 2] = [wrap_angle(yaw) for yaw in differences[:, 2]]
    return differences


def normalised_errors(errors: Array, covariances: Array) -> Array:
    """Each error (N, 3) squared over its covariance (N, 3, 3): (N,), three on average where the covariance is honest.

    NEES of Bar-Shalom, Li and Kirubarajan (2001), 5.4.2; for Gaussian errors its median is 2.37.
    """
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])


def score_trajectory(
    true: Sequence[SE2],
    estimated: Sequence[SE2],
    covariances: Array | None = None,
    lengths_m: Sequence[float] = INDOOR_LENGTHS_M,
) -> dict[str, Any]:
    """All figures of one drive, as `edgemap eval odometry` prints them.

    true, estimated: poses of the same frames. covariances: (N - 1, 3, 3), of each estimated motion. A length that
    does not fit is null. `paper_rmse` is the paper's equation 9: integrated x and y against the truth from a common
    start, in metres, without alignment; the yaw of the end apart, in radians. `nees` is null without covariances.
    """
    drift = {f"{length:g}": segment_drift(true, estimated, length) for length in lengths_m}
    steps_true, steps_found = motions(true), motions(estimated)
    errors = motion_errors(steps_true, steps_found)
    forward, left, yaw = (float(value) for value in np.sqrt((errors**2).mean(axis=0)))
    from_start = [true[0].inverse() @ pose for pose in true], [estimated[0].inverse() @ pose for pose in estimated]
    integrated_errors = motion_errors(*from_start)
    figures: dict[str, Any] = {
        "frames": len(true),
        "path_m": float(path_m(true)[-1]),
        "t_rel_percent": {key: value and value[0] for key, value in drift.items()},
        "r_rel_deg_per_m": {key: value and value[1] for key, value in drift.items()},
        "ate_m": absolute_error_m(true, estimated),
        "rmse_forward_m": forward,
        "rmse_left_m": left,
        "rmse_yaw_rad": yaw,
        "paper_rmse": {
            "xy_m": float(np.sqrt((integrated_errors[:, :2] ** 2).sum(axis=1).mean())),
            "yaw_rad": float(np.sqrt((integrated_errors[:, 2] ** 2).mean())),
        },
        "nees": None,
    }
    if covariances is not None:
        nees = normalised_errors(errors, covariances)
        figures["nees"] = {"mean": float(nees.mean()), "median": float(np.median(nees))}
    return figures


def _same_length(true: Sequence[SE2], estimated: Sequence[SE2]) -> None:
    if len(true) != len(estimated) or not true:
        raise ValueError(f"{len(true)} true poses or motions against {len(estimated)} estimated ones")
