"""Errors of an estimated trajectory: over segments, aligned, per frame, against its covariance, of roll and pitch."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import accumulate, pairwise
from operator import matmul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2, compose_covariance, wrap_angle

Array = NDArray[np.float64]

SEGMENT_STEP = 10  # frames between the starts of two segments, as KITTI has it
WINDOW_SLACK_S = 0.01  # by which a window may be shorter: stamps are rounded


def path_m(poses: Sequence[SE2]) -> Array:
    """Path length up to each pose, metres, (N,), starting at zero."""
    places = np.array([(pose.x_m, pose.y_m) for pose in poses]).reshape(-1, 2)
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])


def motions(poses: Sequence[SE2]) -> list[SE2]:
    """The motion of the base from each pose to the next, one fewer than poses."""
    return [before.inverse() @ after for before, after in pairwise(poses)]


def integrated(steps: Sequence[SE2]) -> list[SE2]:
    """Poses that motions lead to, the identity first: one more than motions."""
    return list(accumulate(steps, matmul, initial=SE2()))


def segment_errors(true: Sequence[SE2], estimated: Sequence[SE2], length_m: float, step: int = SEGMENT_STEP) -> Array:
    """Errors at the end of each segment of one length, (S, 2): metres and radians, absolute values.

    KITTI odometry protocol (Geiger, Lenz and Urtasun 2012): a segment starts every `step` frames and ends at the
    first frame whose true path from there exceeds the length; no alignment beyond the common start.
    """
    travelled_m = path_m(true)
    errors = []
    for start in range(0, len(true), step):
        end = int(np.searchsorted(travelled_m, travelled_m[start] + length_m, side="right"))
        if end >= len(true):
            break
        wanted, estimate = true[start].inverse() @ true[end], estimated[start].inverse() @ estimated[end]
        error = estimate.inverse() @ wanted
        errors.append((math.hypot(error.x_m, error.y_m), abs(error.yaw_rad)))
    return np.array(errors).reshape(-1, 2)


def aligned_errors_m(true: Sequence[SE2], estimated: Sequence[SE2]) -> Array:
    """Position errors after the best rigid alignment, metres, (N,): least squares, closed form.

    Two-dimensional case of Umeyama (1991) without scale, on x + iy.
    """
    wanted, estimate = (np.array([complex(pose.x_m, pose.y_m) for pose in poses]) for poses in (true, estimated))
    wanted, estimate = wanted - wanted.mean(), estimate - estimate.mean()
    turn = complex(np.vdot(estimate, wanted))
    return np.abs((turn / abs(turn) if turn else 1.0) * estimate - wanted)


def motion_errors(true: Sequence[SE2], estimated: Sequence[SE2]) -> Array:
    """Estimated less true motion of each frame: (N, 3) forward m, left m, yaw rad, in the previous base frame."""
    differences = np.array([f.vector() - t.vector() for t, f in zip(true, estimated, strict=True)]).reshape(-1, 3)
    differences[:, 2] = [wrap_angle(yaw) for yaw in differences[:, 2]]
    return differences


def normalised_errors(errors: Array, covariances: Array) -> Array:
    """Each error (N, 3) squared over its covariance (N, 3, 3): (N,), three on average where that is consistent.

    NEES of Bar-Shalom, Li and Kirubarajan (2001), 5.4.2; for Gaussian errors its median is 2.37.
    """
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])


def window_errors(
    true: Sequence[SE2], estimated: Sequence[SE2], covariances: Array, stamps_s: Array, windows_s: Sequence[float]
) -> dict[float, Array]:
    """NEES of the motion over windows of time, (W,) of each length in seconds, started every SEGMENT_STEP frames.

    covariances: (N - 1, 3, 3) of the steps, put together as if independent: errors that last over several steps, of
    scale or of landmarks, show as a NEES that grows with the window.
    """
    steps = motions(estimated)
    errors: dict[float, list[float]] = {length_s: [] for length_s in windows_s}
    for start in range(0, len(true) - 1, SEGMENT_STEP):
        ends = np.searchsorted(stamps_s, stamps_s[start] + np.asarray(windows_s) - WINDOW_SLACK_S)
        wanted = {int(end): length_s for end, length_s in zip(ends, windows_s, strict=True) if end < len(true)}
        pose, covariance = SE2(), np.zeros((3, 3))
        for end in range(start + 1, max(wanted, default=start) + 1):
            covariance = compose_covariance(pose, covariance, steps[end - 1], covariances[end - 1])
            pose = pose @ steps[end - 1]
            if end in wanted:
                error = motion_errors([true[start].inverse() @ true[end]], [pose])
                errors[wanted[end]].append(float(normalised_errors(error, covariance[None])[0]))
    return {length_s: np.array(values) for length_s, values in errors.items()}


def attitude_figures(estimated: Sequence[Attitude | None], true: Sequence[Attitude] | None) -> dict[str, Any]:
    """`sources`: share of the frames in which each provided the attitude. Against true ones, where available:
    `pitch_rms_deg`, `roll_rms_deg`, `max_deg`, and `nees` (2 on average where consistent); else null.
    """
    names = Counter("none" if attitude is None else attitude.source for attitude in estimated)
    sources = {name: round(count / len(estimated), 4) for name, count in names.most_common()}
    pairs = [(own, reference) for own, reference in zip(estimated, true or (), strict=False) if own is not None]
    if not pairs:
        return {"sources": sources, "pitch_rms_deg": None, "roll_rms_deg": None, "max_deg": None, "nees": None}
    off_rad = [(own.roll_rad - real.roll_rad, own.pitch_rad - real.pitch_rad) for own, real in pairs]
    errors = [np.array([wrap_angle(roll), wrap_angle(pitch)]) for roll, pitch in off_rad]
    nees = [float(e @ np.linalg.pinv(own.covariance_rad2) @ e) for e, (own, _) in zip(errors, pairs, strict=True)]
    degrees = np.degrees(np.array(errors))
    roll, pitch = np.sqrt((degrees**2).mean(axis=0)).tolist()
    largest = float(np.abs(degrees).max())
    return {
        "sources": sources, "pitch_rms_deg": pitch, "roll_rms_deg": roll, "max_deg": largest,
        "nees": float(np.mean(nees)),
    }  # fmt: skip


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
    travelled_m = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    relative = np.vstack([segment_errors(above, selected, length) / length for length in lengths_m])
    shift, turn = relative.mean(axis=0) if len(relative) else (None, None)
    return {
        "mean_m": float(apart_m.mean()),
        "max_m": float(apart_m.max()),
        "mean_percent": 100.0 * float(apart_m.mean()) / travelled_m if travelled_m else 0.0,
        "t_rel_percent": None if shift is None else 100.0 * float(shift),
        "r_rel_deg_per_m": None if turn is None else math.degrees(turn),
        "height_mean_m": float(heights_m.mean()),
        "height_max_m": float(heights_m.max()),
    }
