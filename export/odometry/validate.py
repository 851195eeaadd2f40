"""Whole drives through a head, state carried from frame to frame, against the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from edgemap.evaluation.trajectory import integrated, motion_errors, motions, normalised_errors, path_m, segment_errors
from edgemap.export.odometry.clips import make_batch
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow_loss import Batch
from edgemap.geometry.se2 import SE2

CHUNK = 30  # frames at once
SEGMENTS_M = (5.0, 2.0, 1.0)

# A head over a batch of clips with the state before it: motions (B, T, 3), covariances (B, T, 3, 3) or None, new state.
Unroll = Callable[[Any, Batch, list[Tensor] | None], tuple[Tensor, Tensor | None, list[Tensor]]]


@torch.no_grad()
def estimate(
    head: nn.Module, unroll: Unroll, drive: FeatureDrive, window: int = 0
) -> tuple[list[SE2], np.ndarray | None]:
    """A head's motions of one drive, one fewer than frames, and their covariances where it tells any.

    window: motions after which the state starts anew from the last frame; 0 for never.
    """
    state: list[Tensor] | None = None
    motions, covariances = [], []
    count = len(drive.stamps_s)
    chunk = window or CHUNK
    for start in range(0, count - 1, chunk):
        indices = np.arange(start, min(count, start + chunk + 1))
        found, doubt, state = unroll(head, make_batch([(drive, indices)]), None if window else state)
        motions.append(found[0].numpy())
        if doubt is not None:
            covariances.append(doubt[0].numpy())
    steps = [SE2(*row) for row in np.concatenate(motions)]
    return steps, np.concatenate(covariances).astype(np.float64) if covariances else None


def validate(head: nn.Module, unroll: Unroll, drives: Sequence[FeatureDrive], window: int = 0) -> dict[str, Any]:
    """Drift over all segments of 5, 2 and 1 m, per-step RMSE and NEES over all drives; `score` is what chooses."""
    head.eval()
    drifts: dict[float, list[float]] = {length: [] for length in SEGMENTS_M}
    errors, surprises = [], []
    for drive in drives:
        steps, covariances = estimate(head, unroll, drive, window)
        true = [SE2(*row) for row in drive.poses]
        found = integrated(steps)
        error = motion_errors(motions(true), steps)
        errors.append(error)
        if covariances is not None:
            surprises.append(normalised_errors(error, covariances))
        for length in SEGMENTS_M:
            drifts[length].extend(100.0 * segment_errors(true, found, length)[:, 0] / length)
    forward, left, yaw = (float(value) for value in np.sqrt((np.concatenate(errors) ** 2).mean(axis=0)))
    figures: dict[str, Any] = {
        f"t{length:g}_percent": float(np.mean(values)) for length, values in drifts.items() if values
    }
    figures |= {"rmse_forward_m": forward, "rmse_left_m": left, "rmse_yaw_rad": yaw}
    if surprises:
        nees = np.concatenate(surprises)
        figures |= {"nees_mean": float(nees.mean()), "nees_median": float(np.median(nees))}
    way_m = sum(float(path_m([SE2(*row) for row in drive.poses])[-1]) for drive in drives)
    figures["drives"], figures["path_m"] = len(drives), round(way_m, 1)
    # Drift where a segment fits; else the yaw, which is what drift comes from.
    figures["score"] = next((figures[key] for key in ("t5_percent", "t2_percent", "t1_percent") if key in figures), yaw)
    return figures
