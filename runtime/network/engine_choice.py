"""Which engine, and which numbers, run a backbone fastest on this processor: by the bundle's report and by trial."""

import json
import time
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Literal, cast, get_args

import numpy as np

from edgemap.runtime.frames.decisions import Engine
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network.compute import computes_bf16, minimum_ms, processor_name
from edgemap.runtime.network.manifest import Manifest
from edgemap.runtime.network.network import Network
from edgemap.runtime.network.store import cache_folder

EngineChoice = Engine | Literal["auto"]

FASTER = 0.9  # time of another engine over that of onnxruntime, at most, to be taken
INT8_TOLERANCE = 0.1  # YOLOv3-tiny's is 0.04, at the same AP50
PICTURE, FEATURES = 255.0, 0.3  # largest random input of a backbone, and of an odometry head, whose motions are small
TOLERANCE: dict[Engine, float] = {"onnxruntime": 0.0, "openvino": 1e-3, "openvino-bf16": 0.15}  # of `Network.error`
MAXIMUM_LOSS = 0.01  # of AP50
WORTH_IT = 0.9  # time of int8 over that of float32, at most
ROUNDS, WARM_UP = 9, 2  # of both, in turn
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
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(".part").write_text(json.dumps(known, indent=1))
            path.with_suffix(".part").replace(path)
        except OSError:  # a cache that cannot be written costs a trial at the next start
            pass
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
    rounds: int = ROUNDS,
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
