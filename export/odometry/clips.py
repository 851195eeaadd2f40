"""Clips cut from drives at random: other frame rates by skipping, backwards, standing still; all free on features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from edgemap.export.errors import ExportError
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow_loss import ClipBatch

LONGEST_DT_S = 0.25
FASTEST_YAW_RAD, FASTEST_M = 0.30, 0.17  # of one step that skips pictures; what the search can follow


@dataclass(frozen=True, slots=True)
class Clips:
    """How clips are cut. length: frames. skips: chosen among these, as far as `LONGEST_DT_S` allows."""

    length: int = 8
    skips: tuple[int, ...] = (1, 1, 1, 2, 3)
    backwards: float = 0.3
    still: float = 0.05

    def draw(self, drives: Sequence[FeatureDrive], rng: np.random.Generator) -> tuple[FeatureDrive, NDArray[np.intp]]:
        """A drive and the frames of a clip. Drives are chosen by their length. Raises ExportError for one too short."""
        lengths = np.array([len(drive.stamps_s) for drive in drives], dtype=np.float64)
        while True:
            drive = drives[int(rng.choice(len(drives), p=lengths / lengths.sum()))]
            frame_s = float(np.median(np.diff(drive.stamps_s)))
            skip = int(rng.choice([k for k in self.skips if k * frame_s <= LONGEST_DT_S] or [1]))
            span = (self.length - 1) * skip
            if span >= len(drive.stamps_s):
                if skip == 1:
                    raise ExportError(f"{drive.name}: {len(drive.stamps_s)} frames, clips need {span + 1}")
                continue
            first = int(rng.integers(0, len(drive.stamps_s) - span))
            indices = first + np.arange(self.length) * skip
            if rng.random() < self.backwards:
                indices = indices[::-1].copy()
            if rng.random() < self.still:
                stop = int(rng.integers(1, self.length))
                indices[stop:] = indices[stop]
            motions = np.abs(drive.motions(indices))
            if skip == 1 or (motions[:, 2].max() < FASTEST_YAW_RAD and motions[:, :2].max() < FASTEST_M):
                return drive, indices


def make_batch(chosen: Sequence[tuple[FeatureDrive, NDArray[np.intp]]]) -> ClipBatch:
    """Clips as one batch."""
    features, dt_s, motions = [], [], []
    for drive, indices in chosen:
        features.append(np.stack([drive.features[index] for index in indices]).astype(np.float32))
        steps = np.abs(np.diff(drive.stamps_s[indices]))
        frame_s = float(steps.max(initial=0.0)) or float(np.median(np.diff(drive.stamps_s)))
        steps = np.where(steps > 0.0, steps, frame_s)
        dt_s.append(np.concatenate([[frame_s], steps]))
        motions.append(np.concatenate([np.zeros((1, 3)), drive.motions(indices)]))
    return ClipBatch(
        torch.from_numpy(np.stack(features)),
        torch.from_numpy(np.concatenate([drive.cells for drive, _ in chosen])),
        torch.from_numpy(np.concatenate([drive.mount for drive, _ in chosen])),
        torch.from_numpy(np.stack(dt_s).astype(np.float32)),
        torch.from_numpy(np.stack(motions).astype(np.float32)),
    )
