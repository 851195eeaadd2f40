"""Engines: what runs a bundle's networks. One file each; every one gives a `Network`."""

from pathlib import Path

from edgemap.runtime.engines.onnxruntime_cpu import open_onnxruntime
from edgemap.runtime.network import Compute, Network


def open_network(path: Path, compute: Compute) -> Network:
    """Load an ONNX file into the engine asked for. Raises MissingExtraError, or what the engine raises."""
    if compute.engine == "onnxruntime":
        return open_onnxruntime(path, compute)
    from edgemap.runtime.engines.openvino_cpu import open_openvino

    return open_openvino(path, compute)
