"""Trained odometry heads as torch files: what training saves and export reads."""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from edgemap.export.errors import ExportError
from edgemap.export.odometry.flow import FlowHead, FlowSizes
from edgemap.export.odometry.paper import PARAMETER_LIMIT, PaperHead
from edgemap.export.torch_files import fill, read_checkpoint, save_whole
from edgemap.runtime.frames.reading import Name, Share
from edgemap.runtime.network.manifest import Deviation, Span

FORMAT = "edgemap.head/1"
Kind = Literal["paper", "flow"]


@dataclass(frozen=True)
class HeadCheckpoint:
    """A head with its metadata for a bundle. feature: tensor of the backbone that it reads, named as in export (`head`,
    `neck`, `stride4`, …). sigma: standard deviations of forward_m, left_m, yaw_rad of one step. envelope, measured,
    window: as in the manifest. trained: false for random weights.
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


_FLOW_SIZES = ", ".join(item.name for item in fields(FlowSizes))
Width = Annotated[int, Meta(ge=1, le=4096)]


class _OdometryRecord(msgspec.Struct):
    backbone: Name
    feature: Name
    kind: Kind
    trained: bool
    sigma: tuple[Deviation, Deviation, Deviation]
    envelope: dict[Name, Span]
    measured: dict[str, Any]
    shape: tuple[Width, Width, Width, Width]
    window: Annotated[int, Meta(ge=0, le=1 << 40)] = 0
    hidden: Annotated[tuple[Width, ...], Meta(min_length=1, max_length=8)] | None = None
    dense: Width | None = None
    kernel: Annotated[int, Meta(ge=1, le=31)] = 3
    slope: Share = 0.1
    stride: Width | None = None
    sizes: dict[Name, Width] = {}
    unit_m: Annotated[float, Meta(gt=0.0, le=1000.0)] = 1.0


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
        document |= {"stride": head.stride, "sizes": asdict(head.sizes), "unit_m": head.unit_m}
    save_whole(document, path)


def load_head(path: Path) -> HeadCheckpoint:
    """Reads a checkpoint. Raises ExportError where it is invalid, damaged, or exceeds the paper's parameter count."""
    record, weights = read_checkpoint(path, FORMAT, _OdometryRecord)
    head = fill(lambda: _head(record, path), weights, path)
    if isinstance(head, PaperHead) and head.parameters_count > PARAMETER_LIMIT:
        raise ExportError(f"{path}: {head.parameters_count:,} parameters, the paper allows {PARAMETER_LIMIT:,}")
    values = {item.name: getattr(record, item.name) for item in fields(HeadCheckpoint) if item.name != "head"}
    return HeadCheckpoint(head=head.eval(), **values)


def _head(record: _OdometryRecord, path: Path) -> PaperHead | FlowHead:
    if record.kind == "flow" and record.stride is not None:
        return FlowHead(record.shape, record.stride, _sizes(record, path), record.unit_m)
    if record.kind == "paper" and record.hidden is not None and record.dense is not None:
        return PaperHead(record.shape, record.hidden, record.dense, record.kernel, record.slope)
    raise ExportError(f"{path}: a head of kind {record.kind} lacks its sizes")


def _sizes(record: _OdometryRecord, path: Path) -> FlowSizes:
    """Checkpoints of the first, larger heads name none."""
    try:
        return FlowSizes(**record.sizes)
    except TypeError:
        raise ExportError(f"{path}: sizes of a flow head are {_FLOW_SIZES}") from None
