"""Delays Ctrl-C during imports, since some libraries swallow it or turn it into another error."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN_AFTER_S = 0.02


@contextmanager
def interrupts_after_imports() -> Iterator[None]:
    """In the block, a Ctrl-C during an import raises KeyboardInterrupt when the import has finished.

    An extension module that is interrupted while it starts says "initialization failed", or prints a traceback and
    goes on; interrupted clean-up code of the import system drops the Ctrl-C. A second one is raised at once. Has no
    effect outside the main thread, or where another handler for Ctrl-C is installed.
    """
    waiting = False

    def interrupted(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        nonlocal waiting
        if waiting or not _importing(frame):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            raise KeyboardInterrupt
        waiting = True
        signal.setitimer(signal.ITIMER_REAL, AGAIN_AFTER_S)

    def again(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        nonlocal waiting
        waiting = False
        signal.raise_signal(signal.SIGINT)

    here = threading.current_thread() is threading.main_thread()
    if not here or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    handlers = {signal.SIGALRM: again, signal.SIGINT: interrupted}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _importing(frame: FrameType | None) -> bool:
    """Whether an import is under way where this frame runs."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
