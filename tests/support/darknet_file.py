"""Darknet's .weights files as Darknet writes them."""

from pathlib import Path

import numpy as np

from edgemap.export.darknet import Darknet
from edgemap.export.darknet_weights import tensors_in_file_order


def save_weights(network: Darknet, path: Path, seen: int = 0) -> None:
    """Write the network as a .weights file, version 0.2.0."""
    values = [tensor.detach().numpy().astype("<f4").tobytes() for tensor in tensors_in_file_order(network)]
    path.write_bytes(np.array([0, 2, 0], "<i4").tobytes() + np.array([seen], "<u8").tobytes() + b"".join(values))
