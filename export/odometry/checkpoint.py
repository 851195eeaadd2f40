"""Trained odometry heads as torch files: what training saves and export reads."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from edgemap.export.errors import ExportError
from edgemap.export.odometry.paper import LARGE, PARAMETER_LIMIT, PaperHead, eight_bits
from edgemap.export.torch_files import fill, parameter_count, read_checkpoint, save_whole
from edgemap.runtime.frames.reading import Name
from edgemap.runtime.network.manifest import Deviation

FORMAT = "edgemap.head/1"


@dataclass(frozen=True)
class HeadCheckpoint:
    """A paper head with its metadata for a bundle. feature: tensor of the backbone that it reads, named as in export
    (`head`, `neck`, `stride32`, …). sigma: standard deviations of forward_m, left_m, yaw_rad of one step. measured,
    window: as in the manifest. trained: false for random weights.
    """

    head: PaperHead
    backbone: str
    feature: str
    trained: bool = True
    sigma: tuple[float, float, float] = (0.05, 0.05, 0.05)
    measured: dict[str, Any] = field(default_factory=dict)
    window: int = 0


Width = Annotated[int, Meta(ge=1, le=4096)]


class _OdometryRecord(msgspec.Struct):
    backbone: Name
    feature: Name
    trained: bool
    sigma: tuple[Deviation, Deviation, Deviation]
    measured: dict[str, Any]
    shape: tuple[Width, Width, Width, Width]
    window: Annotated[int, Meta(ge=0, le=1 << 40)] = 0
    hidden: Annotated[tuple[Width, ...], Meta(max_length=8)] = ()
    dense: Width = 1


def save_head(checkpoint: HeadCheckpoint, path: Path) -> None:
    """Write a checkpoint: plain values and tensors, whose weights are rounded to 8 bits."""
    head, document = checkpoint.head, {name: value for name, value in vars(checkpoint).items() if name != "head"}
    document |= {"format": FORMAT, "shape": list(head.shape), "hidden": list(head.hidden)}
    weights = head.state_dict()
    for name, tensor in weights.items():
        if tensor.ndim > 1 and tensor.numel() >= LARGE:
            whole, scale = eight_bits(tensor)
            weights[name] = whole * scale
    save_whole(document | {"dense": head.dense.out_features, "state_dict": weights}, path)


def load_head(path: Path) -> HeadCheckpoint:
    """Reads a checkpoint. Raises ExportError where it is invalid, damaged, or exceeds the paper's parameter count."""
    record, weights = read_checkpoint(path, FORMAT, _OdometryRecord)
    head = fill(lambda: PaperHead(record.shape, record.hidden, record.dense), weights, path)
    if (count := parameter_count(head)) > PARAMETER_LIMIT:
        raise ExportError(f"{path}: {count:,} parameters, the paper allows {PARAMETER_LIMIT:,}")
    values = {item.name: getattr(record, item.name) for item in fields(HeadCheckpoint) if item.name != "head"}
    return HeadCheckpoint(head=head.eval(), **values)
