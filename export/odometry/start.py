"""Initial weights of a head: seeded random ones with standardised features, or an earlier head."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from edgemap.export.errors import ExportError
from edgemap.export.exporter import open_backbone
from edgemap.export.odometry.checkpoint import HeadCheckpoint, Kind, load_head
from edgemap.export.odometry.data import FeatureDrive, FeatureStore
from edgemap.export.odometry.flow import SMALL, FlowHead, FlowSizes
from edgemap.export.odometry.paper import PaperHead, random_head
from edgemap.export.odometry.smaller import fit_smaller
from edgemap.export.ranks import Ranks

FIT_DRIVES = 24  # that a smaller head is fitted on: evenly chosen
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
    larger: Path | None = None,
    device: str = "cpu",
    kernel: int = 3,
    slope: float = 0.1,
) -> HeadCheckpoint:
    """The head to train for a store's features. kernel, slope: of the paper's head. Raises ExportError.

    larger: a flow head, of these or another backbone's features, that a small one is fitted to on `FIT_DRIVES` of the
    drives. device: where that is computed.
    """
    sample = _sample(drives, np.random.default_rng(seed))
    if start is not None:
        earlier = load_head(start)
        if earlier.kind != kind or tuple(earlier.head.shape) != tuple(store.shape):
            raise ExportError(
                f"{start}: a {earlier.kind} head for features {tuple(earlier.head.shape)}, "
                f"not {kind} for {tuple(store.shape)}"
            )
        if isinstance(earlier.head, FlowHead):
            earlier.head.unit_m = unit_of(drives)
        if (earlier.backbone, earlier.feature) != (backbone, feature):
            _standardise(earlier.head, sample)
        return HeadCheckpoint(earlier.head, backbone, feature, kind)
    torch.manual_seed(seed)
    if kind == "flow":
        head = FlowHead(store.shape, store.stride, FlowSizes() if larger is None else SMALL, unit_of(drives))
    else:
        head = random_head(store.shape, seed, kernel, slope)
        head.motion_scale.copy_(torch.from_numpy(_scale(drives)))
    _standardise(head, sample)
    if larger is not None and isinstance(head, FlowHead):
        _fit(head, larger, store, drives[:: -(-len(drives) // FIT_DRIVES)], device)
    return HeadCheckpoint(head, backbone, feature, kind)


def unit_of(drives: Sequence[FeatureDrive]) -> float:
    """The unit in which a flow head counts lengths, metres: the distance to the nearest floor that these cameras see,
    the median of them, as a power of two. Up to 2.8 m it is 1, because rooms are of similar size, and 1 where no floor
    is in view; KITTI's is 8."""
    nearest = [1.0 / most for drive in drives if (most := float(drive.cells[:, 6].max())) > 0.0]
    unit_m = 2.0 ** round(math.log2(np.median(nearest))) if nearest else 1.0
    return unit_m if unit_m > 2.0 else 1.0


def _fit(head: FlowHead, larger: Path, store: FeatureStore, drives: Sequence[FeatureDrive], device: str) -> None:
    """Raises ExportError where the larger head is of another kind or grid."""
    teacher = load_head(larger)
    if not isinstance(teacher.head, FlowHead) or (teacher.head.rows, teacher.head.columns) != (head.rows, head.columns):
        raise ExportError(
            f"{larger}: a {teacher.kind} head for features {tuple(teacher.head.shape)}, not a flow head to fit"
        )
    part = open_backbone(teacher.backbone, None, [teacher.feature])
    same_place = msgspec.structs.replace(part.detector.input, resize=store.input.resize)
    part = replace(part, detector=msgspec.structs.replace(part.detector, input=same_place))
    theirs = FeatureStore(part, teacher.feature, store.folder.parent, 1)
    if theirs.folder == store.folder:
        head.feature_mean.copy_(teacher.head.feature_mean)
        head.feature_std.copy_(teacher.head.feature_std)
        pairs = [(drive, drive) for drive in drives]
    else:
        pairs = list(zip(drives, theirs.load([drive.name for drive in drives]), strict=True))
    place = Ranks(device).device
    fit_smaller(head.to(place), teacher.head.to(place), pairs)
    head.cpu()


def _standardise(head: FlowHead | PaperHead, sample: torch.Tensor) -> None:
    """Features of mean 0 and deviation 1. A channel that hardly changes is mostly rounding: it is not blown up."""
    mean = sample.mean(dim=(0, 2, 3), keepdim=True)
    head.feature_mean.copy_(mean)
    head.feature_std.copy_(sample.std(dim=(0, 2, 3), keepdim=True) + 1e-3 + 0.01 * mean.abs())


def _sample(drives: Sequence[FeatureDrive], rng: np.random.Generator) -> torch.Tensor:
    chosen = [drives[int(rng.integers(len(drives)))] for _ in range(SAMPLES)]
    return torch.from_numpy(np.stack([d.features[int(rng.integers(len(d)))] for d in chosen]).astype(np.float32))


def _scale(drives: Sequence[FeatureDrive]) -> NDArray[np.float32]:
    """Standard deviations of the true motions, (3,)."""
    motions = np.concatenate([drive.motions(np.arange(len(drive))) for drive in drives])
    return (motions.std(axis=0) + 1e-3).astype(np.float32)
