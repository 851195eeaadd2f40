"""Engines: what runs a bundle's networks, on how many threads. Every one gives a `Network`.

Threads change no result: onnxruntime's outputs are the same to the bit (a test holds that).
"""

import os
import platform
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.inference import Engine
from edgemap.runtime.frames.reading import library_path, one_line
from edgemap.runtime.network.network import Compute, Network, Tensors

Pace = Literal["camera", "files"]  # a frame now and then, or as fast as they are read

ROWS = "rows"  # name of an input's height in files that leave it open
SPIN_US = "300"  # longer than between two operators, shorter than what a step does between two networks


def compute_at(pace: Pace, threads: int | None = None, engine: Engine = "onnxruntime") -> Compute:
    """How a backbone computes at this pace. threads: None for one at a camera's pace, which leaves the other cores to
    the robot's other programs, and for two where files are read as fast as possible and the machine has two cores.
    Idle threads spin for files only.
    """
    threads = threads or (1 if pace == "camera" else min(2, _cores()))
    return Compute(threads, pace == "files" and threads > 1, engine)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processor_name() -> str:
    """The processor's name as the system reports it, else its architecture."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


def open_network(source: Path | bytes, compute: Compute, rows: int | None = None) -> Network:
    """Load an ONNX file, or a model in memory, into the engine asked for. rows: of the input, where the file leaves
    them open. Raises BundleError or MissingExtraError.
    """
    if compute.engine == "openvino":
        return _open_openvino(source, compute, rows)
    session = open_session(source, compute, rows)
    inputs, outputs = (
        {node.name: tuple(node.shape) for node in nodes} for nodes in (session.get_inputs(), session.get_outputs())
    )
    metadata = session.get_modelmeta().custom_metadata_map
    return Network(inputs, outputs, lambda tensors: run_session(session, tensors, _name_of(source)), metadata)


def open_session(source: Path | bytes, compute: Compute, rows: int | None = None) -> ort.InferenceSession:
    """A session for an ONNX file or a model in memory: one operator at a time, quiet, on the threads asked for.

    rows: of the input, where the file leaves them open. Raises BundleError where onnxruntime does not load it.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = compute.threads
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", str(int(compute.spin)))
    options.add_session_config_entry("session.intra_op.spin_duration_us", SPIN_US)
    options.log_severity_level = 4
    if rows is not None:
        options.add_free_dimension_override_by_name(ROWS, rows)
    model = source if isinstance(source, bytes) else library_path(source)
    try:
        return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"], enable_fallback=0)
    except Exception as error:  # onnxruntime's exceptions share no public base
        raise _not_loaded(source, "onnxruntime", error) from None


def _name_of(source: Path | bytes) -> Path | str:
    return source if isinstance(source, Path) else "a network"


def _not_loaded(source: Path | bytes, engine: Engine, error: Exception) -> BundleError:
    why = one_line(str(error).removeprefix("[ONNXRuntimeError] : "), 160)
    return BundleError(f"{_name_of(source)}: not a model that {engine} loads ({why})")


def run_session(session: ort.InferenceSession, tensors: Any, name: object) -> Any:
    """All outputs of a session in its order. Raises BundleError, which begins with the name."""
    try:
        return session.run(None, tensors)
    except Exception as error:  # as above
        raise BundleError(f"{name}: the network fails as it runs ({one_line(error, 160)})") from None


@cache
def openvino_core() -> Any:
    """The one `openvino.Core` of this process; it is never released.

    Every core gives its thread a signal stack, and restores the previous one when it is released. With two, the one
    released last restores the stack of the first, which is unmapped by then: the next signal (Ctrl-C) ends the process
    (SIGSEGV).
    """
    import openvino as ov

    return ov.Core()


def _open_openvino(source: Path | bytes, compute: Compute, rows: int | None) -> Network:
    """Compiled for latency, in float32."""
    need("openvino", "--engine openvino")
    config = {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": compute.threads,
        "INFERENCE_PRECISION_HINT": "f32",
        "ENABLE_CPU_PINNING": False,  # the threads of two networks would be held to one core
    }
    try:
        core = openvino_core()
        model = core.read_model(source if isinstance(source, bytes) else library_path(source))
        if model.is_dynamic():
            (port,) = model.inputs
            channels, columns = (port.get_partial_shape()[axis].get_length() for axis in (1, 3))
            model.reshape({port.get_any_name(): [1, channels, rows, columns]})
        request = core.compile_model(model, "CPU", config).create_infer_request()
    except Exception as error:  # OpenVINO's share no public base either
        raise _not_loaded(source, "openvino", error) from None
    inputs, outputs = (
        {port.get_any_name(): tuple(port.shape) for port in ports} for ports in (model.inputs, model.outputs)
    )

    def infer(tensors: Tensors) -> list[NDArray[np.float32]]:
        request.infer(tensors, share_inputs=True)
        # Copies: the request writes into the same memory at the next run, and a state must outlive it.
        return [request.get_output_tensor(index).data.copy() for index in range(len(outputs))]

    return Network(inputs, outputs, infer)
