"""Work shared by a few processes, results in order: pictures are independent of one another."""

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from edgemap.simulation.errors import SimulationError

_AHEAD = 4
T = TypeVar("T")
R = TypeVar("R")


def default_workers() -> int:
    """Two, where there are two cores: each works on its own pictures with one thread."""
    return min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def ordered(
    work: Callable[[T], R], tasks: Iterable[T], workers: int, prepare: Callable[..., None], *given: Any
) -> Iterator[R]:
    """`work(task)` for every task, in order, a few ahead of the reader.

    Each process calls `prepare(*given)` first; functions must be importable and `given` picklable. Failures of the work
    are raised here as they were there. Raises SimulationError where a process dies.
    """
    # Fresh processes: neither OpenGL nor a network's threads outlive a fork.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, _start, (prepare, given))
    try:
        waiting: deque[Future[R]] = deque()
        for task in tasks:
            waiting.append(pool.submit(work, task))
            if len(waiting) > _AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    except BrokenProcessPool:
        raise SimulationError("a rendering process died (out of memory?)") from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start(prepare: Callable[..., None], given: tuple[Any, ...]) -> None:
    """One thread per process; Ctrl-C is the parent's business."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Mesa draws in this process's own thread: with 1 it would start another one and wait for it.
    os.environ |= {"LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    import cv2

    cv2.setNumThreads(1)
    prepare(*given)
