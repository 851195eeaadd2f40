"""Engines: what runs a bundle's networks. One file each; every one gives a `Network`."""

from pathlib import Path

from edgemap.runtime.engines.onnxruntime_cpu import open_onnxruntime
from edgemap.runtime.network import Compute, Network


def open_network(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Load an ONNX file into the engine asked for. rows: of the input, where the file leaves them open.

    Raises MissingExtraError, or what the engine raises.
    """
    if compute.engine == "onnxruntime":
        return open_onnxruntime(path, compute, rows)
    from edgemap.runtime.engines.openvino_cpu import open_openvino

    return open_openvino(path, compute, rows)
