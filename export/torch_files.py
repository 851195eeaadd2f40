"""Torch files of plain values and tensors: read with specific errors, written atomically."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import convert, one_line

FILE_BYTES = 512 << 20

T = TypeVar("T")
Network = TypeVar("Network", bound=nn.Module)


def read_torch(path: Path, form: str | None = None) -> dict[str, Any]:
    """A torch file of plain values and tensors; torch unpickles nothing else.

    Raises ExportError where it cannot be read, or is of another format than `form`.
    """
    if not path.is_file():
        raise ExportError(f"{path}: no such checkpoint")
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(item.file_size for item in archive.infolist())
        if unpacked > FILE_BYTES:
            raise ExportError(f"{path}: {unpacked:,} bytes unpacked, at most {FILE_BYTES:,} are read")
        document = torch.load(path, map_location="cpu", weights_only=True)
    except ExportError:
        raise
    except Exception as error:  # torch raises UnpicklingError, RuntimeError, EOFError, …
        raise ExportError(f"{path}: not a torch checkpoint ({one_line(error, 120)})") from None
    if not isinstance(document, dict):
        raise ExportError(f"{path}: holds a {type(document).__name__}, no checkpoint")
    if form is not None and document.get("format") != form:
        raise ExportError(f"{path}: format {one_line(repr(document.get('format')), 60)}, expected {form!r}")
    return document


def kind_of(path: Path) -> str:
    """What a checkpoint holds by its format `edgemap.KIND/N`: detector, floor, head. Raises ExportError."""
    return str(read_torch(path).get("format")).removeprefix("edgemap.").partition("/")[0]


def read_checkpoint(path: Path, form: str, kind: type[T]) -> tuple[T, dict[str, Tensor]]:
    """The plain values of a checkpoint, checked, others left out; and its `state_dict`: dense tensors by name.

    Raises ExportError where it is invalid, or of another format than `form`.
    """
    document = read_torch(path, form)
    record = convert(document, kind, f"{path}: checkpoint", ExportError)
    weights = document.get("state_dict")
    if not isinstance(weights, dict) or not all(isinstance(name, str) for name in weights):
        raise ExportError(f"{path}: its state_dict is no weights by name")
    for name, tensor in weights.items():
        dense = isinstance(tensor, Tensor) and tensor.layout == torch.strided and tensor.device.type == "cpu"
        if not dense or tensor.is_quantized or tensor.nbytes > tensor.untyped_storage().nbytes():
            raise ExportError(f"{path}: {one_line(name, 60)!r} in its state_dict is no dense tensor")
    return record, dict(weights)


def fill(build: Callable[[], Network], weights: dict[str, Tensor], path: Path) -> Network:
    """The network that `build` makes, with these weights; shapes are compared before memory is taken.

    Raises ExportError where they do not fit, or are not finite.
    """
    try:
        with torch.device("meta"):
            shapes = {name: tuple(tensor.shape) for name, tensor in build().state_dict().items()}
    except Exception as error:  # torch's layers raise whatever they like at sizes that cannot be
        raise ExportError(f"{path}: describes no network ({one_line(error, 120)})") from None
    found = {name: tuple(tensor.shape) for name, tensor in weights.items()}
    if odd := sorted(shapes.items() ^ found.items()):
        names = list(dict.fromkeys(one_line(name, 60) for name, _ in odd))
        raise ExportError(f"{path}: weights do not fit their network ({len(names)} differ: {', '.join(names[:3])})")
    network = build()
    network.load_state_dict(weights)
    finite(network, path)
    return network


def save_whole(document: dict[str, Any], path: Path) -> None:
    """Write a torch file beside its place and rename it there."""
    part = path.with_name(f".{path.name}.part")
    torch.save(document, part)
    part.replace(path)


def parameter_count(network: nn.Module) -> int:
    """Trainable numbers of a network."""
    return sum(parameter.numel() for parameter in network.parameters())


def finite(network: nn.Module, path: Path) -> None:
    """Raises ExportError where weights that came from `path` are not finite."""
    if not all(bool(torch.isfinite(tensor).all()) for tensor in network.state_dict().values()):
        raise ExportError(f"{path}: holds weights that are not finite")
