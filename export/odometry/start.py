"""What training a head begins with: seeded random weights, features standardised; or an earlier head."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, Kind, load_head
from edgemap.export.odometry.data import FeatureDrive, FeatureStore
from edgemap.export.odometry.flow import SLOPE, SMALL, FlowHead, FlowSizes
from edgemap.export.odometry.paper import PaperHead, random_head

SAMPLES = 64  # frames that mean and deviation are taken from


def begin(
    kind: Kind,
    store: FeatureStore,
    drives: Sequence[FeatureDrive],
    backbone: str,
    feature: str,
    *,
    seed: int = 0,
    start: Path | None = None,
    teacher: FlowHead | None = None,
    kernel: int = 3,
    slope: float = 0.1,
) -> HeadCheckpoint:
    """The head to train for a store's features. kernel, slope: of the paper's head. Raises ExportError.

    teacher: a larger flow head for these features, whose descriptions of cells are the first ones.
    """
    sample = _sample(drives, np.random.default_rng(seed))
    if start is not None:
        earlier = load_head(start)
        if earlier.kind != kind or tuple(earlier.head.shape) != tuple(store.shape):
            raise ExportError(
                f"{start}: a {earlier.kind} head for features {tuple(earlier.head.shape)}, "
                f"not {kind} for {tuple(store.shape)}"
            )
        if (earlier.backbone, earlier.feature) != (backbone, feature):
            _standardise(earlier.head, sample)
        return HeadCheckpoint(earlier.head, backbone, feature, kind)
    torch.manual_seed(seed)
    if kind == "flow":
        head = FlowHead(store.shape, store.stride, FlowSizes() if teacher is None else SMALL)
    else:
        head = random_head(store.shape, seed, kernel, slope)
        head.motion_scale.copy_(torch.from_numpy(_scale(drives)))
    _standardise(head, sample)
    if teacher is not None and isinstance(head, FlowHead):
        _describe_like(head, teacher, sample)
    return HeadCheckpoint(head, backbone, feature, kind)


def load_teacher(path: Path, store: FeatureStore) -> FlowHead:
    """A flow head for a store's features. Raises ExportError."""
    head = load_head(path).head
    if not isinstance(head, FlowHead) or tuple(head.shape) != tuple(store.shape):
        raise ExportError(f"{path}: a head for features {tuple(head.shape)}, not a flow head for {tuple(store.shape)}")
    return head


def _standardise(head: FlowHead | PaperHead, sample: torch.Tensor) -> None:
    """Features of mean 0 and deviation 1. A channel that hardly changes is mostly rounding: it is not blown up."""
    mean = sample.mean(dim=(0, 2, 3), keepdim=True)
    head.feature_mean.copy_(mean)
    head.feature_std.copy_(sample.std(dim=(0, 2, 3), keepdim=True) + 1e-3 + 0.01 * mean.abs())


@torch.no_grad()
def _describe_like(head: FlowHead, teacher: FlowHead, sample: torch.Tensor) -> None:
    """Cells described by the directions in which the teacher's descriptions of a sample differ most."""
    head.feature_mean.copy_(teacher.feature_mean)
    head.feature_std.copy_(teacher.feature_std)
    head.sharpness.copy_(teacher.sharpness)
    head.evidence.copy_(teacher.evidence)
    fine, coarse = teacher.describe(sample)
    turn = _main_directions(fine, head.sizes.fine)
    head.reduce.weight.copy_(torch.einsum("ij,jkvu->ikvu", turn, teacher.reduce.weight))
    head.reduce.bias.copy_(turn @ teacher.reduce.bias)  # type: ignore[operator]
    wanted = torch.einsum("ij,bjvu->bivu", _main_directions(coarse, head.sizes.coarse), coarse)
    fit(head.coarsen, functional.leaky_relu(head.describe_fine(sample), SLOPE), wanted)


@torch.no_grad()
def fit(conv: nn.Conv2d, inputs: torch.Tensor, wanted: torch.Tensor) -> None:
    """The weights with which a convolution makes of inputs (B, C, H, W) what is nearest to wanted (B, D, h, w)."""
    patches = functional.unfold(inputs, conv.kernel_size, 1, conv.padding, conv.stride)  # type: ignore[arg-type]
    rows = patches.transpose(1, 2).flatten(0, 1)
    rows = torch.cat([rows, torch.ones_like(rows[:, :1])], dim=1).double()
    normal = rows.T @ rows
    normal += 1e-4 * normal.diagonal().mean() * torch.eye(len(normal))
    found = torch.linalg.solve(normal, rows.T @ wanted.flatten(2).transpose(1, 2).flatten(0, 1).double())
    conv.weight.copy_(found[:-1].T.unflatten(1, conv.weight.shape[1:]))
    conv.bias.copy_(found[-1])  # type: ignore[union-attr]


def _main_directions(described: torch.Tensor, count: int) -> torch.Tensor:
    """(count, C) orthonormal, of vectors (B, C, H, W)."""
    rows = described.transpose(0, 1).flatten(1)
    return torch.linalg.eigh(torch.cov(rows))[1].flip(1)[:, :count].T


def _sample(drives: Sequence[FeatureDrive], rng: np.random.Generator) -> torch.Tensor:
    chosen = [drives[int(rng.integers(len(drives)))] for _ in range(SAMPLES)]
    return torch.from_numpy(np.stack([d.features[int(rng.integers(len(d)))] for d in chosen]).astype(np.float32))


def _scale(drives: Sequence[FeatureDrive]) -> NDArray[np.float32]:
    """Standard deviations of the true motions, (3,)."""
    motions = np.concatenate([drive.motions(np.arange(len(drive))) for drive in drives])
    return (motions.std(axis=0) + 1e-3).astype(np.float32)
