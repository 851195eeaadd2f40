"""Whole drives through a head, state carried from frame to frame, against the truth."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from edgemap.evaluation.odometry import INDOOR_LENGTHS_M, KITTI_LENGTHS_M, errors_of, figures
from edgemap.evaluation.trajectory import integrated, path_m
from edgemap.export.odometry.clips import Shelf, make_batch
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow import FlowHead
from edgemap.export.odometry.flow_loss import ClipBatch
from edgemap.geometry.se2 import SE2

CHUNK = 30  # frames at once

# A head over a batch of clips with the state before it: motions (B, T, 3), covariances (B, T, 3, 3) or None, new state.
Unroll = Callable[[Any, ClipBatch, list[Tensor] | None], tuple[Tensor, Tensor | None, list[Tensor]]]


@torch.no_grad()
def estimate(
    head: nn.Module, unroll: Unroll, drive: FeatureDrive, window: int = 0
) -> tuple[list[SE2], np.ndarray | None]:
    """A head's motions of one drive, one fewer than frames, and their covariances where it has any.

    window: motions after which the state starts again from the last frame; 0 for never.
    """
    shelf = Shelf((), next(head.parameters()).device)
    state: list[Tensor] | None = None
    motions, covariances = [], []
    count = len(drive.stamps_s)
    chunk = window or CHUNK
    for start in range(0, count - 1, chunk):
        indices = np.arange(start, min(count, start + chunk + 1))
        found, doubt, state = unroll(head, make_batch([(drive, indices)], shelf), None if window else state)
        motions.append(found[0].cpu().numpy())
        if doubt is not None:
            covariances.append(doubt[0].cpu().numpy())
    steps = [SE2(*row) for row in np.concatenate(motions)]
    return steps, np.concatenate(covariances).astype(np.float64) if covariances else None


def segment_lengths_m(unit_m: float, path_m: float) -> tuple[float, ...]:
    """The lengths over which a head that counts in this unit is judged: as a robot at home, or, where the unit is a
    road's, those of KITTI that are shorter than the path."""
    if unit_m == 1.0:
        return INDOOR_LENGTHS_M
    return tuple(m for m in KITTI_LENGTHS_M if m < path_m) or tuple(unit_m * m for m in INDOOR_LENGTHS_M)


def validate(head: nn.Module, unroll: Unroll, drives: Sequence[FeatureDrive], window: int = 0) -> dict[str, Any]:
    """Drift over all `segment_lengths_m`, per-step RMSE and NEES over all drives; `score` is what chooses."""
    head.eval()
    unit_m = head.unit_m if isinstance(head, FlowHead) else 1.0
    errors = []
    for drive in drives:
        steps, covariances = estimate(head, unroll, drive, window)
        true = [SE2(*row) for row in drive.poses]
        lengths_m = segment_lengths_m(unit_m, float(path_m(true)[-1]))
        errors.append(errors_of(true, integrated(steps), covariances, lengths_m))
    found = figures(errors)
    drifts = {f"t{length}_percent": value for length, value in found["t_rel_percent"].items()}
    summary: dict[str, Any] = {name: value for name, value in drifts.items() if value is not None}
    # Drift over the lengths that fit (short drives at high rates have no long ones), else the yaw, where it comes from.
    score = sum(summary.values()) / len(summary) if summary else found["rmse_yaw_rad"]
    summary |= {name: found[name] for name in ("rmse_forward_m", "rmse_left_m", "rmse_yaw_rad")}
    if found["nees"] is not None:
        summary |= {"nees_mean": found["nees"], "nees_median": found["nees_median"]}
    return summary | {"drives": len(drives), "path_m": round(found["path_m"], 1), "score": score}
