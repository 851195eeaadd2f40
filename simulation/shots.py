"""Work shared by a few processes, results in order; and a world's pictures made so."""

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from typing import Any, TypeVar

from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.scene import LitScene
from edgemap.simulation.studio import Shot, Studio, lit_home
from edgemap.simulation.world import World

_AHEAD = 4
T = TypeVar("T")
R = TypeVar("R")


def ordered(
    work: Callable[[T], R], tasks: Iterable[T], prepare: Callable[..., None] | None = None, *given: Any
) -> Iterator[R]:
    """`work(task)` for every task, in order, a few ahead of the reader, by two processes where there are two cores:
    each with one thread.

    Each process calls `prepare(*given)` first; functions must be importable and `given` picklable. Failures of the work
    are raised here as they were there. Raises SimulationError where a process dies.
    """
    # Fresh processes: neither OpenGL nor a network's threads outlive a fork.
    context, workers = multiprocessing.get_context("spawn"), min(2, len(os.sched_getaffinity(0)))
    pool = ProcessPoolExecutor(workers, context, _start, (prepare, *given))
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


def _start(prepare: Callable[..., None] | None, *given: Any) -> None:
    """One thread per process; Ctrl-C is the parent's business."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Mesa draws in this process's own thread: with 1 it would start another one and wait for it.
    os.environ |= {"LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    import cv2

    cv2.setNumThreads(1)
    if prepare:
        prepare(*given)


# Below this many pictures starting processes takes longer than it saves.
_FEW = 40
_studio: Studio | None = None


def shots(world: World, indices: Iterable[int]) -> Generator[Shot, None, None]:
    """Pictures of the given indices, in that order; the same whatever the number of processes."""
    todo = list(indices)
    if not todo:
        return
    lit = lit_home(world)
    if len(todo) >= _FEW and len(os.sched_getaffinity(0)) > 1:
        yield from ordered(_shoot, todo, _open, world, lit)
        return
    with closing(Studio(world, lit)) as studio:
        yield from map(studio.shoot, todo)


def _open(world: World, lit: LitScene) -> None:
    global _studio
    _studio = Studio(world, lit)


def _shoot(index: int) -> Shot:
    assert _studio is not None
    return _studio.shoot(index)
