"""Errors of an odometry, as `edgemap eval odometry` reports them: of one drive, or pooled over several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.trajectory import (
    SEGMENT_STEP,
    aligned_errors_m,
    motion_errors,
    motions,
    normalised_errors,
    path_m,
    segment_errors,
    window_errors,
)
from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]

INDOOR_LENGTHS_M = (1.0, 2.0, 5.0)
WINDOWS_S = (1.0, 2.0, 5.0, 10.0)  # over which summed motions are judged against their covariance
KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
STILL_M, STILL_RAD = 0.5e-3, math.radians(0.01)  # a base whose true motion is less than both stands still


@dataclass(frozen=True, slots=True, eq=False)
class DriveErrors:
    """All single errors of one drive of N frames.

    segments: by length in m, (S, 2) metres and radians. aligned_m: (N,) after alignment. steps: (N - 1, 3) forward m,
    left m, yaw rad of each motion. from_start: (N, 3) of the poses from a common start. nees: (N - 1,), (0,) without
    covariances. window_nees: by length in s, as of `window_errors`, (0,) without covariances or stamps. still: (K, 2),
    metres and radians that were estimated in each frame of standing still.
    """

    path_m: float
    segments: dict[float, Array]
    aligned_m: Array
    steps: Array
    from_start: Array
    nees: Array
    window_nees: dict[float, Array]
    still: Array


def errors_of(
    true: Sequence[SE2],
    estimated: Sequence[SE2],
    covariances: Array | None = None,
    lengths_m: Sequence[float] = INDOOR_LENGTHS_M,
    stamps_s: Array | None = None,
    step: int = SEGMENT_STEP,
) -> DriveErrors:
    """Compare poses of the same frames, two at least. covariances: (N - 1, 3, 3), of each estimated motion. stamps_s:
    (N,). step: frames between the starts of two segments."""
    steps_true, steps_estimated = motions(true), motions(estimated)
    steps = motion_errors(steps_true, steps_estimated)
    starts = [true[0].inverse() @ pose for pose in true], [estimated[0].inverse() @ pose for pose in estimated]
    still = [
        (math.hypot(motion.x_m, motion.y_m), abs(motion.yaw_rad))
        for wanted, motion in zip(steps_true, steps_estimated, strict=True)
        if math.hypot(wanted.x_m, wanted.y_m) < STILL_M and abs(wanted.yaw_rad) < STILL_RAD
    ]
    windows = dict.fromkeys(WINDOWS_S, np.zeros(0))
    if covariances is not None and stamps_s is not None:
        windows = window_errors(true, estimated, covariances, stamps_s, WINDOWS_S)
    return DriveErrors(
        path_m=float(path_m(true)[-1]),
        segments={length: segment_errors(true, estimated, length, step) for length in lengths_m},
        aligned_m=aligned_errors_m(true, estimated),
        steps=steps,
        from_start=motion_errors(*starts),
        nees=np.zeros(0) if covariances is None else normalised_errors(steps, covariances),
        window_nees=windows,
        still=np.array(still).reshape(-1, 2),
    )


def figures(drives: Sequence[DriveErrors]) -> dict[str, Any]:
    """The figures of all drives pooled: every segment, frame and pose counts once.

    A length that fits no drive is null. `paper_rmse` is the paper's equation 9: integrated x and y against the truth
    from a common start, in metres, without alignment; the yaw apart. `nees` is three on average where the covariances
    are consistent, and null without them; `window_nees`, by seconds, is that of motions summed over such a time, null
    where none fits. `still`: what is estimated while the base stands still, null where it never does.
    """
    lengths = sorted({length for drive in drives for length in drive.segments})
    segments = {length: np.vstack([d.segments[length] for d in drives if length in d.segments]) for length in lengths}
    relative = {length: errors / length for length, errors in segments.items()}
    every = np.vstack([*relative.values(), np.zeros((0, 2))])
    steps, from_start = (np.vstack([getattr(d, name) for d in drives]) for name in ("steps", "from_start"))
    forward, left, yaw = (float(value) for value in np.sqrt((steps**2).mean(axis=0)))
    nees = np.concatenate([drive.nees for drive in drives])
    windows = {length_s: np.concatenate([drive.window_nees[length_s] for drive in drives]) for length_s in WINDOWS_S}
    still = np.vstack([drive.still for drive in drives])
    return {
        "frames": len(from_start),
        "path_m": sum(drive.path_m for drive in drives),
        "t_rel_percent": {f"{length:g}": mean(100.0 * r[:, 0]) for length, r in relative.items()},
        "r_rel_deg_per_m": {f"{length:g}": mean(np.degrees(r[:, 1])) for length, r in relative.items()},
        "t_rel_mean_percent": mean(100.0 * every[:, 0]),
        "r_rel_mean_deg_per_m": mean(np.degrees(every[:, 1])),
        "segments": {f"{length:g}": len(errors) for length, errors in segments.items()},
        "ate_m": _rms(np.concatenate([drive.aligned_m for drive in drives])),
        "rmse_forward_m": forward,
        "rmse_left_m": left,
        "rmse_yaw_rad": yaw,
        "paper_rmse": _rms(np.linalg.norm(from_start[:, :2], axis=1)),
        "paper_rmse_yaw_rad": _rms(from_start[:, 2]),
        "nees": mean(nees),
        "nees_median": float(np.median(nees)) if len(nees) else None,
        "window_nees": {f"{length_s:g}": mean(errors) for length_s, errors in windows.items()},
        "still": {
            "frames": len(still),
            "cm_per_frame": _mean_and_max(100.0 * still[:, 0]),
            "deg_per_frame": _mean_and_max(np.degrees(still[:, 1])),
        },
    }


def worst_drive(drives: dict[str, DriveErrors]) -> dict[str, Any] | None:
    """The drive with the largest drift over the longest segments that most drives have; None where none fits."""
    drifts = dict[float, dict[str, float]]()
    for name, drive in drives.items():
        for length, errors in drive.segments.items():
            if len(errors):
                drifts.setdefault(length, {})[name] = 100.0 * float(errors[:, 0].mean()) / length
    if not drifts:
        return None
    length, drift = max(drifts.items(), key=lambda item: (len(item[1]), item[0]))
    name = max(drift, key=drift.__getitem__)
    return {"sequence": name, "length_m": length, "t_rel_percent": drift[name]}


def mean(values: Array) -> float | None:
    """The mean; None of nothing."""
    return float(values.mean()) if len(values) else None


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def _mean_and_max(values: Array) -> dict[str, float] | None:
    return {"mean": float(values.mean()), "max": float(values.max())} if len(values) else None
