"""Torch files of plain values and tensors: read with every failure named, written whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

from edgemap.export.errors import ExportError


def read_torch(path: Path) -> dict[str, Any]:
    """A torch file of plain values. Raises ExportError."""
    if not path.is_file():
        raise ExportError(f"{path}: no such checkpoint")
    try:
        document = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises UnpicklingError, RuntimeError, EOFError, …
        raise ExportError(f"{path}: not a torch checkpoint ({str(error).splitlines()[0][:120]})") from None
    if not isinstance(document, dict):
        raise ExportError(f"{path}: holds a {type(document).__name__}, no checkpoint")
    return document


def save_whole(document: dict[str, Any], path: Path) -> None:
    """Write a torch file beside its place and rename it there."""
    part = path.with_name(f".{path.name}.part")
    torch.save(document, part)
    part.replace(path)


def finite(network: nn.Module, path: Path) -> None:
    """Raises ExportError where weights that came from `path` are not finite."""
    if not all(bool(torch.isfinite(tensor).all()) for tensor in network.state_dict().values()):
        raise ExportError(f"{path}: holds weights that are not finite")
