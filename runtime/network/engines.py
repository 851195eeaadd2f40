"""Engines: what runs a bundle's networks; every one gives a `Network`."""

from pathlib import Path
from typing import Any

import onnxruntime as ort

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.reading import library_path, one_line
from edgemap.runtime.network.network import Compute, Network, Tensors

PROVIDERS = ["CPUExecutionProvider"]
ROWS = "rows"  # name of an input's height in files that leave it open
SPIN_US = "300"  # longer than between two operators, shorter than what a step does between two networks


def open_network(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Load an ONNX file into the engine asked for. rows: of the input, where the file leaves them open.

    Raises MissingExtraError, or what the engine raises.
    """
    if compute.engine == "onnxruntime":
        return open_onnxruntime(path, compute, rows)
    from edgemap.runtime.network.openvino import open_openvino

    return open_openvino(path, compute, rows)


def session_options(compute: Compute, rows: int | None = None) -> ort.SessionOptions:
    """One operator at a time, quiet, on the threads asked for. rows: of the input, where the file leaves them open."""
    options = ort.SessionOptions()
    options.intra_op_num_threads = compute.threads
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", str(int(compute.spin)))
    options.add_session_config_entry("session.intra_op.spin_duration_us", SPIN_US)
    options.log_severity_level = 4
    if rows is not None:
        options.add_free_dimension_override_by_name(ROWS, rows)
    return options


def open_onnxruntime(source: Path | bytes, compute: Compute, rows: int | None = None) -> Network:
    """Load an ONNX file, or a model in memory. Raises what onnxruntime raises, which shares no public base."""
    model = source if isinstance(source, bytes) else library_path(source)
    session = ort.InferenceSession(model, session_options(compute, rows), providers=PROVIDERS, enable_fallback=0)
    outputs = {node.name: tuple(node.shape) for node in session.get_outputs()}
    inputs = {node.name: tuple(node.shape) for node in session.get_inputs()}

    def run(tensors: Tensors) -> Any:
        try:
            return session.run(list(outputs), tensors)  # pyright: ignore[reportArgumentType]
        except Exception as error:
            name = source if isinstance(source, Path) else "a network"
            raise BundleError(f"{name}: the network fails as it runs ({one_line(error, 160)})") from None

    return Network(inputs, outputs, run, session.get_modelmeta().custom_metadata_map)
