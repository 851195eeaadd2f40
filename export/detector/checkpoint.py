"""Detector checkpoints: `best.pt` (small, what export reads) and `last.pt` (all that a resume needs)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from edgemap.export.detector.blocks import fold_norms
from edgemap.export.detector.classes import nano_classes
from edgemap.export.detector.network import Nano
from edgemap.export.errors import ExportError
from edgemap.export.torch_files import finite, read_torch, save_whole

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
        raise ExportError(f"{path}: format {document.get('format')!r}, expected {FORMAT!r}")
    try:
        names = tuple(str(name) for name in document["names"])
        nano_classes(names)
        network = Nano(len(names), bool(document["norm"]))
        network.load_state_dict(document["state_dict"] | _unrefined(network, document["state_dict"]))
        checkpoint = DetectorCheckpoint(
            network.eval(),
            names,
            int(document["size"]),
            str(document["start"]),
            str(document["licence"]),
            tuple(document["sources"]),
            dict(document["measured"]),
        )
    except KeyError as error:
        raise ExportError(f"{path}: lacks {error.args[0]!r}, or it is no class of COCO") from None
    except (RuntimeError, TypeError, ValueError) as error:
        raise ExportError(f"{path}: weights do not fit their network ({str(error).splitlines()[0][:120]})") from None
    finite(network, path)
    if fold and network.norm:
        fold_norms(network)
        network.norm = False
    return checkpoint


def _unrefined(network: Nano, weights: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """For weights of before there were refinements: those of a network that does not refine yet."""
    own = {name: tensor for name, tensor in network.state_dict().items() if name.startswith("refinements.")}
    return {} if own.keys() & weights.keys() else own


def is_detector(path: Path) -> bool:
    """Whether a torch file is a detector's checkpoint, and not an odometry head's. Raises ExportError."""
    return read_torch(path).get("format") == FORMAT
