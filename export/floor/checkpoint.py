"""A trained floor head as a torch file: what training saves and export reads."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from edgemap.export.floor.head import FloorHead
from edgemap.export.torch_files import fill, read_checkpoint, save_whole
from edgemap.runtime.frames.reading import Name
from edgemap.runtime.network.manifest import Text

FORMAT = "edgemap.floor/2"
Channels = Annotated[int, Meta(ge=1, le=4096)]
Rows = Annotated[int, Meta(ge=0, le=4096)]
Four = tuple[Channels, Channels, Channels, Channels]


@dataclass(frozen=True)
class FloorCheckpoint:
    """A head with its metadata for a bundle. backbone: the network whose features it reads. taps: names of those
    tensors, strides 4 to 32. measured: figures with their data. sources: where its labels came from.
    """

    head: FloorHead
    backbone: str
    taps: tuple[str, ...]
    measured: dict[str, Any] = field(default_factory=dict)
    sources: tuple[str, ...] = ()


class _Record(msgspec.Struct):
    backbone: Name
    taps: tuple[Name, Name, Name, Name]
    measured: dict[str, Any]
    channels: Four
    rows: Rows
    width: Channels
    deep: Annotated[int, Meta(ge=0, le=64)] = 0
    sources: tuple[Text, ...] = ()


def save_floor(checkpoint: FloorCheckpoint, path: Path) -> None:
    """Write a checkpoint: plain values and float32 tensors."""
    head, document = checkpoint.head, {name: value for name, value in vars(checkpoint).items() if name != "head"}
    document |= {"channels": head.channels, "rows": head.rows, "width": head.width, "deep": len(head.deep)}
    save_whole({"format": FORMAT, **document, "state_dict": head.state_dict()}, path)


def load_floor(path: Path) -> FloorCheckpoint:
    """Reads a checkpoint. Raises ExportError where it is invalid or damaged."""
    record, weights = read_checkpoint(path, FORMAT, _Record)
    shape = record.channels, record.rows, record.width, record.deep
    head = fill(lambda: FloorHead(*shape), weights, path)
    return FloorCheckpoint(head.eval(), record.backbone, record.taps, record.measured, record.sources)
