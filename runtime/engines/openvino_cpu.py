"""OpenVINO on the CPU (extra `openvino`)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.extras import need
from edgemap.runtime.network import Compute, Network, Tensors

need("openvino", "--engine openvino", ("openvino",))

import openvino as ov  # noqa: E402


def open_openvino(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Compile an ONNX file for latency. rows: of the input, where the file leaves them open. Raises what OpenVINO
    raises."""
    core = ov.Core()
    model = core.read_model(path)
    if model.is_dynamic():
        (port,) = model.inputs
        channels, columns = (port.get_partial_shape()[axis].get_length() for axis in (1, 3))
        model.reshape({port.get_any_name(): [1, channels, rows, columns]})
    precision = "bf16" if compute.engine == "openvino-bf16" else "f32"
    config = {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": compute.threads,
        "INFERENCE_PRECISION_HINT": precision,
        "ENABLE_CPU_PINNING": False,  # the threads of two networks would be held to one core
    }
    request = core.compile_model(model, "CPU", config).create_infer_request()
    outputs = {port.get_any_name(): tuple(port.shape) for port in model.outputs}

    def infer(tensors: Tensors) -> list[NDArray[np.float32]]:
        request.infer(tensors, share_inputs=True)
        # Copies: the request writes into the same memory at the next run, and a state must outlive it.
        return [request.get_output_tensor(index).data.copy() for index in range(len(outputs))]

    return Network({port.get_any_name(): tuple(port.shape) for port in model.inputs}, outputs, infer)
