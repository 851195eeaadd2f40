"""What readers leave out of their files: faults of the run that opens them, or lines on standard error."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.reading import print_message

_COLLECTED: ContextVar[list[Fault] | None] = ContextVar("faults", default=None)


@contextmanager
def collected() -> Iterator[list[Fault]]:
    """Collects the notes of the block, for who reports them; prints them where the block fails."""
    faults: list[Fault] = []
    token = _COLLECTED.set(faults)
    try:
        yield faults
    except BaseException:
        for fault in faults:
            print_message(fault.text)
        raise
    finally:
        _COLLECTED.reset(token)


def note(kind: FaultKind, text: str) -> None:
    """Reports something that is left out. text: one line with the numbers."""
    faults = _COLLECTED.get()
    if faults is None:
        print_message(text)
    else:
        faults.append(Fault(kind, text))


def note_dropped(where: object, reasons: list[str], count: int) -> None:
    """Reports samples that were dropped, with the first reason. count: of all samples."""
    if reasons:
        note(FaultKind.SAMPLES, f"{where}: {len(reasons)} of {count} samples dropped ({reasons[0]})")
