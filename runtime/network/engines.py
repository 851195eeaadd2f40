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

PROVIDERS = ["CPUExecutionProvider"]
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


def one_blas_thread() -> None:
    """Let numpy's and scipy's BLAS compute on one thread in this process: the matrices of a step are small."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, "blas")


def processor_name() -> str:
    """The processor's name as the system reports it, else its architecture."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


def open_network(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Load an ONNX file into the engine asked for. rows: of the input, where the file leaves them open.

    Raises MissingExtraError, or what the engine raises.
    """
    opened = open_onnxruntime if compute.engine == "onnxruntime" else open_openvino
    return opened(path, compute, rows)


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


@cache
def openvino_core() -> Any:
    """The one `openvino.Core` of this process; it is never released.

    Every core gives its thread a signal stack, and restores the previous one when it is released. With two, the one
    released last restores the stack of the first, which is unmapped by then: the next signal (Ctrl-C) ends the process
    (SIGSEGV).
    """
    import openvino as ov

    return ov.Core()


def open_openvino(path: Path, compute: Compute, rows: int | None = None) -> Network:
    """Compile an ONNX file for latency, in float32. rows: of the input, where the file leaves them open. Raises
    MissingExtraError, or what OpenVINO raises."""
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
    inputs, outputs = (
        {port.get_any_name(): tuple(port.shape) for port in ports} for ports in (model.inputs, model.outputs)
    )

    def infer(tensors: Tensors) -> list[NDArray[np.float32]]:
        request.infer(tensors, share_inputs=True)
        # Copies: the request writes into the same memory at the next run, and a state must outlive it.
        return [request.get_output_tensor(index).data.copy() for index in range(len(outputs))]

    return Network(inputs, outputs, infer)
