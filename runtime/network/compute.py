"""Choice of engine and number of threads on this machine, by measurement, since other programs need the cores too.
Threads change no result: onnxruntime's outputs are the same to the bit (a test holds that).
"""

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from edgemap.runtime.frames.decisions import Engine
from edgemap.runtime.network.network import Compute, Network

Pace = Literal["camera", "files"]  # a frame now and then, or as fast as they are read

# One thread is enough where it takes no longer than this: on two cores with 10 frames/s, edgemap-nano's backbone takes
# 8.5 ms on one thread, 8.8 on two that sleep and 7.4 on two that spin, and a frame 20, 27 and 58 ms of processor time.
ONE_THREAD_MS = 15.0
WORTH_IT: dict[Pace, float] = {"camera": 0.8, "files": 0.92}  # time on all threads over that on one, at most
WARM_UP, ROUNDS = 2, 4
CPUINFO = Path("/proc/cpuinfo")


def settle(
    open_network: Callable[[Compute], Network],
    pace: Pace,
    threads: int | None = None,
    engine: Engine = "onnxruntime",
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Network, Compute]:
    """A network opened with what a short trial finds best here. threads: as the user asks, else one or the default's.

    For a camera no thread spins, and a second one is taken where one is slow. For files all threads spin, unless the
    machine is busy with other work: then spinning takes more than it gives.
    """
    spin = pace == "files"
    limit = threads or default_threads()
    if limit == 1 or threads:
        compute = Compute(limit, spin and limit > 1, engine)
        return open_network(compute), compute
    one = open_network(Compute(1, engine=engine))
    alone_ms = minimum_ms(one, clock)
    if not spin and alone_ms <= ONE_THREAD_MS:
        return one, Compute(1, engine=engine)
    compute = Compute(limit, spin, engine)
    all_threads = open_network(compute)
    if minimum_ms(all_threads, clock) <= WORTH_IT[pace] * alone_ms:
        return all_threads, compute
    return one, Compute(1, engine=engine)


def minimum_ms(network: Network, clock: Callable[[], float] = time.perf_counter) -> float:
    """The shortest of a few runs, ms."""
    tensors, times = network.zeros(), []
    for _ in range(WARM_UP + ROUNDS):
        before = clock()
        network.run(tensors)
        times.append(1e3 * (clock() - before))
    return min(times[WARM_UP:])


def default_threads() -> int:
    """Two, or one where the machine has only one core to give."""
    return max(1, min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1))


def one_blas_thread() -> None:
    """Let numpy's and scipy's BLAS compute on one thread in this process: the matrices of a step are small."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, "blas")


def multiplies_int8(cpuinfo: Path = CPUINFO) -> bool:
    """Whether products of 8-bit numbers are added up exactly: on x86 with VNNI only, elsewhere always.

    Without it pairs of products are added in 16 bits, which overflow.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    return bool({"avx512_vnni", "avx_vnni"} & _flags(cpuinfo))


def computes_bf16() -> bool:
    """Whether an x86 processor multiplies numbers of 16 bits with float32's exponent."""
    return bool({"avx512_bf16", "amx_bf16"} & _flags(CPUINFO))


def _flags(cpuinfo: Path) -> set[str]:
    if not cpuinfo.is_file():
        return set()
    return set(next((line for line in cpuinfo.read_text().splitlines() if line.startswith("flags")), "").split())


def processor_name() -> str:
    """The processor's name as the system reports it, else its architecture."""
    if CPUINFO.is_file():
        for line in CPUINFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
