"""float32 or int8: whether a bundle's own report allows the smaller numbers, and whether they are faster here."""

import time
from collections.abc import Callable
from typing import Literal

import numpy as np

from edgemap.runtime.manifest import Manifest

Numbers = Literal["float32", "int8"]
Precision = Numbers | Literal["auto"]

MAXIMUM_LOSS = 0.01  # of AP50
WORTH_IT = 0.9  # time of int8 over that of float32, at most
ROUNDS, WARM_UP = 9, 2
REST_S = 0.02  # before each run, so that the other network's spinning threads do not slow it


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
