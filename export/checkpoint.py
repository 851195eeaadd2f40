"""Trained odometry heads as torch files: what training saves and export reads."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import torch

from edgemap.export.convlstm import PARAMETER_LIMIT, PaperHead
from edgemap.export.errors import ExportError

FORMAT = "edgemap.head/1"


@dataclass(frozen=True)
class HeadCheckpoint:
    """A head with all that a bundle says about it.

    feature: which tensor of the backbone it reads, in export's words (`head`, `neck`, `stride32`, …). sigma: standard
    deviations of forward_m, left_m, yaw_rad of one step. envelope, measured: as in the manifest. trained: false for
    random weights.
    """

    head: PaperHead
    backbone: str
    feature: str
    kind: Literal["paper"] = "paper"
    trained: bool = True
    sigma: tuple[float, float, float] = (0.05, 0.05, 0.05)
    envelope: dict[str, tuple[float, float]] = field(default_factory=dict)
    measured: dict[str, Any] = field(default_factory=dict)


def save_head(checkpoint: HeadCheckpoint, path: Path) -> None:
    """Write a checkpoint: plain values and tensors, nothing that needs unpickling of code."""
    head = checkpoint.head
    document: dict[str, Any] = {
        item.name: getattr(checkpoint, item.name) for item in fields(checkpoint) if item.name != "head"
    }
    document |= {
        "format": FORMAT,
        "shape": list(head.shape),
        "hidden": list(head.hidden),
        "dense": head.dense.out_features,
        "state_dict": head.state_dict(),
    }
    torch.save(document, path)


def load_head(path: Path) -> HeadCheckpoint:
    """Read a checkpoint. Raises ExportError where it is none, is damaged, or exceeds the paper's parameter count."""
    if not path.is_file():
        raise ExportError(f"{path}: no such checkpoint")
    try:
        document = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises UnpicklingError, RuntimeError, EOFError, …
        raise ExportError(f"{path}: not a torch checkpoint ({str(error).splitlines()[0][:120]})") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise ExportError(f"{path}: format {found!r}, expected {FORMAT!r}")
    if document.get("kind") != "paper":
        raise ExportError(f"{path}: head of kind {document.get('kind')!r}, this edgemap knows paper")
    try:
        head = PaperHead(document["shape"], document["hidden"], document["dense"])
        head.load_state_dict(document["state_dict"])
        values = {key: document[key] for key in ("backbone", "feature", "kind", "trained", "envelope", "measured")}
        sigma = tuple(float(value) for value in document["sigma"])
    except KeyError as error:
        raise ExportError(f"{path}: lacks {error.args[0]!r}") from None
    except (RuntimeError, TypeError, ValueError) as error:
        raise ExportError(f"{path}: weights do not fit their head ({str(error).splitlines()[0][:120]})") from None
    if head.parameters_count > PARAMETER_LIMIT:
        raise ExportError(f"{path}: {head.parameters_count:,} parameters, the paper allows {PARAMETER_LIMIT:,}")
    if not all(bool(torch.isfinite(tensor).all()) for tensor in head.state_dict().values()):
        raise ExportError(f"{path}: holds weights that are not finite")
    return HeadCheckpoint(head=head.eval(), sigma=sigma, **values)  # type: ignore[arg-type]
