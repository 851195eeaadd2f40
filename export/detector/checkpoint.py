"""Detector checkpoints: `best.pt` (small, what export reads) and `last.pt` (all that a resume needs)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
import torch
from msgspec import Meta

from edgemap.export.detector.blocks import fold_norms
from edgemap.export.detector.classes import nano_classes
from edgemap.export.detector.network import Nano
from edgemap.export.errors import ExportError
from edgemap.export.torch_files import fill, read_record, read_torch, read_weights, save_whole
from edgemap.runtime.manifest import Text
from edgemap.runtime.reading import Name, one_line

FORMAT = "edgemap.detector/1"
RESUME_FORMAT = "edgemap.detector-run/1"


@dataclass(frozen=True)
class DetectorCheckpoint:
    """A trained network with what a bundle says about it. size: side of the input, px. start: its start weights."""

    network: Nano
    names: tuple[str, ...]
    size: int
    start: str
    licence: str
    sources: tuple[str, ...]
    measured: dict[str, Any] = field(default_factory=dict)


class _Record(msgspec.Struct):
    norm: bool
    names: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=1000)]
    size: Annotated[int, Meta(ge=32, le=4096)]
    start: Text
    licence: Text
    sources: tuple[Text, ...]
    measured: dict[str, Any]


def save_detector(checkpoint: DetectorCheckpoint, path: Path) -> None:
    """Write float16 weights, whole at once."""
    weights = {
        name: tensor.half() if tensor.is_floating_point() else tensor
        for name, tensor in checkpoint.network.state_dict().items()
    }
    document = {
        "format": FORMAT,
        "norm": checkpoint.network.norm,
        "names": list(checkpoint.names),
        "size": checkpoint.size,
        "start": checkpoint.start,
        "licence": checkpoint.licence,
        "sources": list(checkpoint.sources),
        "measured": checkpoint.measured,
        "state_dict": weights,
    }
    save_whole(document, path)


def load_detector(path: Path, fold: bool = True) -> DetectorCheckpoint:
    """Read a checkpoint in float32, normalisation folded unless told. Raises ExportError where it is none."""
    document = read_torch(path)
    if document.get("format") != FORMAT:
        raise ExportError(f"{path}: format {one_line(repr(document.get('format')), 60)}, expected {FORMAT!r}")
    record, weights = read_record(document, _Record, path), read_weights(document, path)
    try:
        nano_classes(record.names)
    except KeyError as error:
        raise ExportError(f"{path}: {error.args[0]!r} is no class of COCO") from None

    def build() -> Nano:
        return Nano(len(record.names), record.norm)

    network = fill(build, _unrefined(build, weights) | weights, path).eval()
    checkpoint = DetectorCheckpoint(
        network, record.names, record.size, record.start, record.licence, record.sources, record.measured
    )
    if fold and network.norm:
        fold_norms(network)
        network.norm = False
    return checkpoint


def _unrefined(build: Callable[[], Nano], weights: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """For weights of before there were refinements: those of a network that does not refine yet."""
    with torch.device("meta"):
        names = {name for name in build().state_dict() if not name.startswith("refinements.")}
    if names != weights.keys():  # has refinements, or fits nothing
        return {}
    return {name: tensor for name, tensor in build().state_dict().items() if name.startswith("refinements.")}


def is_detector(path: Path) -> bool:
    """Whether a torch file is a detector's checkpoint, and not an odometry head's. Raises ExportError."""
    return read_torch(path).get("format") == FORMAT
