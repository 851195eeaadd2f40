"""Darknet's .weights files: a short header, then float32 values layer by layer, every one accounted for."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from edgemap.export.darknet import Darknet
from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import read_bytes

FILE_BYTES = 1 << 30  # YOLOv3 has 248 million
WIDE_SEEN = 2  # from version 0.2 on, `seen` is 64 bits wide
# Of a convolution, which has either a bias or a normalisation.
FILE_ORDER = ("conv.bias", "norm.bias", "norm.weight", "norm.running_mean", "norm.running_var", "conv.weight")
RANDOM_RANGES = {"norm.weight": (0.5, 1.0), "norm.running_var": (0.5, 1.5)}


def tensors_in_file_order(network: Darknet) -> list[Tensor]:
    """The network's tensors as the file orders them: biases, then scales, means, variances if normalised, weights."""
    ordered: list[Tensor] = []
    for layer in network.convolutions():
        values = layer.state_dict()  # shares the network's memory
        ordered += [values[name] for name in FILE_ORDER if name in values]
    return ordered


def value_count(network: Darknet) -> int:
    """How many float32 values the network's weights file holds."""
    return sum(tensor.numel() for tensor in tensors_in_file_order(network))


def _header(data: bytes, path: Path) -> tuple[int, int]:
    """Length of the header in bytes, and pictures that the training had seen: three int32, then `seen` as int32 or
    int64 by version. Raises ExportError."""
    if len(data) < 16:
        raise ExportError(f"{path}: {len(data)} bytes, too short for a Darknet header of 16 or 20")
    major, minor, revision = (int(number) for number in np.frombuffer(data, "<i4", 3))
    if not (0 <= major < 1000 and 0 <= minor < 1000):
        raise ExportError(f"{path}: not a Darknet weights file (its version reads {major}.{minor}.{revision})")
    length = 20 if major * 10 + minor >= WIDE_SEEN else 16
    if len(data) < length:
        raise ExportError(f"{path}: {len(data)} bytes, too short for a Darknet header of {length}")
    return length, int(np.frombuffer(data, "<u8" if length == 20 else "<u4", 1, offset=12)[0])


def load_weights(network: Darknet, path: Path) -> int:
    """Fill the network from a .weights file of exactly its size; gives the number of pictures that its training had
    seen. Raises ExportError with both counts."""
    data = read_bytes(path, ExportError, FILE_BYTES)
    length, seen = _header(data, path)
    body = len(data) - length
    expected = value_count(network)
    if body != 4 * expected:
        odd = f" and {body % 4} bytes more" if body % 4 else ""
        how = "short" if body < 4 * expected else "long"
        raise ExportError(
            f"{path}: too {how} for {network.name}: expected {expected:,} float32 values, found {body // 4:,}{odd}"
        )
    values = np.frombuffer(data, "<f4", offset=length)
    if bad := int(np.count_nonzero(~np.isfinite(values))):
        raise ExportError(f"{path}: {bad:,} of {expected:,} values are not finite: damaged")
    tensors = tensors_in_file_order(network)
    ends = np.cumsum([tensor.numel() for tensor in tensors])
    for tensor, piece in zip(tensors, np.split(values, ends[:-1]), strict=True):
        tensor.copy_(torch.tensor(piece).view(tensor.shape))
    return seen


def random_weights(network: Darknet, seed: int = 0) -> None:
    """Fill the network with seeded random values whose activations keep their size through many layers."""
    generator = torch.Generator().manual_seed(seed)
    for name, tensor in (row for layer in network.convolutions() for row in layer.state_dict().items()):
        if name == "conv.weight":
            tensor.normal_(0.0, (2.0 / tensor[0].numel()) ** 0.5, generator=generator)
        elif name in RANDOM_RANGES:
            tensor.uniform_(*RANDOM_RANGES[name], generator=generator)
        elif tensor.is_floating_point():
            tensor.normal_(0.0, 0.1, generator=generator)
