"""Faults in tests."""

from collections.abc import Iterable

from edgemap.runtime.frames.faults import Fault, FaultKind


def made(text: str, kind: FaultKind = FaultKind.ODOMETRY) -> Fault:
    """A fault of any kind."""
    return Fault(kind, text)


def texts(faults: Iterable[Fault]) -> str:
    """The texts of faults in one line."""
    return "; ".join(map(str, faults))


def kinds(faults: Iterable[Fault]) -> list[str]:
    """The kinds of faults."""
    return [fault.kind.value for fault in faults]
