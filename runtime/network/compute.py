"""Threads of a backbone, BLAS's threads, and the processor's name. Threads change no result: onnxruntime's outputs are
the same to the bit (a test holds that).
"""

import os
import platform
from pathlib import Path
from typing import Literal

from edgemap.runtime.frames.inference import Engine
from edgemap.runtime.network.network import Compute

Pace = Literal["camera", "files"]  # a frame now and then, or as fast as they are read

CPUINFO = Path("/proc/cpuinfo")


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
    if CPUINFO.is_file():
        for line in CPUINFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
