"""Engine, numbers and threads of a backbone on this machine, by the bundle's report and by trial.

Other programs need the cores too. Threads change no result: onnxruntime's outputs are the same to the bit (a test holds
that).
"""

import json
import os
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from edgemap.runtime.frames.decisions import Engine
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import BundleError, DiskError
from edgemap.runtime.network.manifest import Manifest
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.network.store import cache_folder

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


EngineChoice = Engine | Literal["auto"]

FASTER = 0.9  # time of another engine over that of onnxruntime, at most, to be taken
INT8_TOLERANCE = 0.1  # YOLOv3-tiny's is 0.04, at the same AP50
PICTURE, FEATURES = 255.0, 0.3  # largest random input of a backbone, and of an odometry head, whose motions are small
TOLERANCE: dict[Engine, float] = {"onnxruntime": 0.0, "openvino": 1e-3, "openvino-bf16": 0.15}  # of `Network.error`
MAXIMUM_LOSS = 0.01  # of AP50
INT8_WORTH_IT = 0.9  # time of int8 over that of float32, at most
PAIRED_ROUNDS = 9  # of both, in turn
REST_S = 0.02  # before each run, so that the other network's spinning threads do not slow it


def stored_engine(key: str, load: Callable[[Engine], Network]) -> Engine:
    """The fastest engine for this key on this processor, from the cache or by a trial now.

    load: a bundle's backbone in an engine.
    """
    path = cache_folder() / "engines.json"
    key = f"{processor_name()}, {_versions()}, {key}"
    try:
        known = json.loads(path.read_text())
    except (OSError, ValueError):
        known = {}
    if not isinstance(known, dict) or known.get(key) not in get_args(Engine):
        known = (known if isinstance(known, dict) else {}) | {key: best_engine(available_engines(), load)}
        with suppress(OSError, DiskError):  # a cache that cannot be written costs a trial at the next start
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, json.dumps(known, indent=1))
    return cast(Engine, known[key])


def best_engine(engines: Sequence[Engine], load: Callable[[Engine], Network]) -> Engine:
    """The fastest of the engines, the first one unless another is clearly faster; engines whose outputs disagree are
    excluded.
    """
    best, best_ms = engines[0], FASTER * minimum_ms(load(engines[0]))
    for engine in engines[1:]:
        try:
            ms = minimum_ms(load(engine))
        except BundleError:
            continue
        if ms < best_ms:
            best, best_ms = engine, ms
    return best


def agrees(network: Network, reference: Network, engine: Engine, int8: bool = False, largest: float = PICTURE) -> bool:
    """Whether the outputs are onnxruntime's, within the engine's tolerance. int8: of networks that round in between.
    largest: of the random inputs."""
    tolerance = max(TOLERANCE[engine], INT8_TOLERANCE) if int8 else TOLERANCE[engine]
    return network.error(reference, largest) <= tolerance


def available_engines() -> tuple[Engine, ...]:
    """The engines that `auto` tries, onnxruntime first; bf16 where the processor has it: it costs at most 0.006 AP50 on
    photographs and leaves odometry and map unchanged (benchmarks/README.md).
    """
    if find_spec("openvino") is None:
        return ("onnxruntime",)
    return ("onnxruntime", "openvino", "openvino-bf16") if computes_bf16() else ("onnxruntime", "openvino")


def _versions() -> str:
    found = []
    for name in ("onnxruntime", "openvino"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def report_allows_int8(manifest: Manifest) -> bool:
    """Whether the bundle has an int8 variant whose measured loss of AP50 is small; one not measured is not trusted."""
    variant = manifest.variants.get("int8")
    ap50 = variant.measured.get("ap50") if variant else None
    return ap50 is not None and round(ap50["float32"] - ap50["int8"], 6) <= MAXIMUM_LOSS


def time_ratio(
    one: Callable[[], object],
    other: Callable[[], object],
    clock: Callable[[], float] = time.perf_counter,
    rest_s: float = REST_S,
    rounds: int = PAIRED_ROUNDS,
) -> float:
    """Median time of `one` over that of `other`, run in turn on this processor."""
    repeats: list[list[float]] = [[], []]
    for order in range(WARM_UP + rounds):
        for call, times in zip((one, other), repeats, strict=True):
            time.sleep(rest_s)
            before = clock()
            call()
            if order >= WARM_UP:
                times.append(clock() - before)
    return float(np.median(repeats[0]) / np.median(repeats[1]))
