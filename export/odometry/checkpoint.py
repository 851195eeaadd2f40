"""Trained odometry heads as torch files: what training saves and export reads."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from edgemap.export.errors import ExportError
from edgemap.export.odometry.flow import FlowHead
from edgemap.export.odometry.paper import PARAMETER_LIMIT, PaperHead
from edgemap.export.torch_files import finite, read_torch, save_whole

FORMAT = "edgemap.head/1"
Kind = Literal["paper", "flow"]


@dataclass(frozen=True)
class HeadCheckpoint:
    """A head with all that a bundle says about it.

    feature: which tensor of the backbone it reads, in export's words (`head`, `neck`, `stride4`, …). sigma: standard
    deviations of forward_m, left_m, yaw_rad of one step. envelope, measured, window: as in the manifest. trained: false
    for random weights.
    """

    head: PaperHead | FlowHead
    backbone: str
    feature: str
    kind: Kind = "paper"
    trained: bool = True
    sigma: tuple[float, float, float] = (0.05, 0.05, 0.05)
    envelope: dict[str, tuple[float, float]] = field(default_factory=dict)
    measured: dict[str, Any] = field(default_factory=dict)
    window: int = 0


def save_head(checkpoint: HeadCheckpoint, path: Path) -> None:
    """Write a checkpoint: plain values and float32 tensors, nothing that needs unpickling of code."""
    head = checkpoint.head
    document: dict[str, Any] = {
        item.name: getattr(checkpoint, item.name) for item in fields(checkpoint) if item.name != "head"
    }
    document |= {"format": FORMAT, "shape": list(head.shape), "state_dict": head.state_dict()}
    if isinstance(head, PaperHead):
        document |= {
            "hidden": list(head.hidden),
            "dense": head.dense.out_features,
            "kernel": head.kernel,
            "slope": head.slope,
        }
    else:
        document["stride"] = head.stride
    save_whole(document, path)


def load_head(path: Path) -> HeadCheckpoint:
    """Read a checkpoint. Raises ExportError where it is none, is damaged, or exceeds the paper's parameter count."""
    document = read_torch(path)
    if document.get("format") != FORMAT:
        raise ExportError(f"{path}: format {document.get('format')!r}, expected {FORMAT!r}")
    try:
        head = _head(path, document)
        head.load_state_dict(document["state_dict"])
        names = ("backbone", "feature", "kind", "trained", "measured")
        values = {key: document[key] for key in names} | {"window": int(document.get("window", 0))}
        sigma = tuple(float(value) for value in document["sigma"])
        envelope = {str(key): tuple(span) for key, span in document["envelope"].items()}
    except KeyError as error:
        raise ExportError(f"{path}: lacks {error.args[0]!r}") from None
    except (RuntimeError, TypeError, ValueError) as error:
        raise ExportError(f"{path}: weights do not fit their head ({str(error).splitlines()[0][:120]})") from None
    if isinstance(head, PaperHead) and head.parameters_count > PARAMETER_LIMIT:
        raise ExportError(f"{path}: {head.parameters_count:,} parameters, the paper allows {PARAMETER_LIMIT:,}")
    finite(head, path)
    return HeadCheckpoint(head=head.eval(), sigma=sigma, envelope=envelope, **values)  # type: ignore[arg-type]


def _head(path: Path, document: dict[str, Any]) -> PaperHead | FlowHead:
    kind = document.get("kind")
    if kind == "paper":
        extra = document.get("kernel", 3), document.get("slope", 0.1)
        return PaperHead(document["shape"], document["hidden"], document["dense"], *extra)
    if kind == "flow":
        return FlowHead(document["shape"], int(document["stride"]))
    raise ExportError(f"{path}: head of kind {kind!r}, this edgemap knows paper and flow")
