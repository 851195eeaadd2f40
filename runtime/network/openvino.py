"""OpenVINO as an engine, in float32 on the processor."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import library_path
from edgemap.runtime.network.network import Compute, Network, Tensors


@cache
def openvino_core() -> Any:
    """The one `openvino.Core` of this process; it is never released.

    Every core gives its thread a signal stack of its own, and restores the previous one when it is released. With
    two, the one released last restores the stack of the first, which is unmapped by then: the next signal (Ctrl-C)
    ends the process (SIGSEGV).
    """
    import openvino as ov

    return ov.Core()


def open_openvino(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Compile an ONNX file for latency. rows: of the input, where the file leaves them open. Raises MissingExtraError,
    or what OpenVINO raises."""
    need("openvino", "--engine openvino")
    core = openvino_core()
    model = core.read_model(library_path(path))
    if model.is_dynamic():
        (port,) = model.inputs
        channels, columns = (port.get_partial_shape()[axis].get_length() for axis in (1, 3))
        model.reshape({port.get_any_name(): [1, channels, rows, columns]})
    config = {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": compute.threads,
        "INFERENCE_PRECISION_HINT": "f32",
        "ENABLE_CPU_PINNING": False,  # the threads of two networks would be held to one core
    }
    request = core.compile_model(model, "CPU", config).create_infer_request()
    outputs = {port.get_any_name(): tuple(port.shape) for port in model.outputs}

    def infer(tensors: Tensors) -> list[NDArray[np.float32]]:
        request.infer(tensors, share_inputs=True)
        # Copies: the request writes into the same memory at the next run, and a state must outlive it.
        return [request.get_output_tensor(index).data.copy() for index in range(len(outputs))]

    return Network({port.get_any_name(): tuple(port.shape) for port in model.inputs}, outputs, infer)
