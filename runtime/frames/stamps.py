"""Stamps of a recorded stream: single wrong ones are dropped, a clock that was set is followed."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from edgemap.geometry.errors import EdgemapError

T = TypeVar("T")
AGREEING = 3  # stamps that show that a clock was set
PAUSE = 86_400  # seconds: no recording pauses for longer


def followed(
    samples: Iterable[tuple[float, T]], second: int = 1, recorded: Callable[[T], float] | None = None
) -> Iterator[tuple[float | None, T, str]]:
    """(stamp, sample, fault) for each (stamp, sample), by stamps that strictly increase.

    A stamp that is not after the last one, or that all later ones come before, has None for its stamp and a fault: the
    sample is to be dropped. Where three stamps in a row lie before the last one in order, or more than a day after it,
    the clock was set: the stream continues by the new clock, shifted, with one fault. Stamps are unchanged otherwise,
    to the bit. second: of the stamps' unit; 1e9 for whole nanoseconds. recorded: stamp by the recorder's clock, which
    shows a clock that was set forward by more than a second.
    """
    source, ahead = iter(samples), deque[tuple[float, T]]()
    last = most = -float("inf")  # most: by which a stamp was ahead of the recorder's
    offset, ended = 0, False
    failure: EdgemapError | None = None
    while True:
        while not ended and len(ahead) < AGREEING:
            try:
                ahead.append(next(source))
            except StopIteration:
                ended = True
            except EdgemapError as error:  # raised once the samples before it are delivered
                ended, failure = True, error
        if not ahead:
            if failure is not None:
                raise failure
            return
        leads = [other + offset - recorded(one) for other, one in ahead] if recorded else [0.0]
        raw, sample = ahead.popleft()
        stamp, later = raw + offset, [other + offset for other, _ in ahead]
        agree = len(later) == AGREEING - 1 and stamp < later[0] < later[1]
        fault = ""
        if last == -float("inf") and len(later) > 1 and later[0] - stamp > PAUSE * second > later[1] - later[0]:
            fault = f"at {raw / second:.6f} s, more than a day before the stamps that follow, skipped"
        elif agree and (
            later[1] <= last
            or (stamp > last + second > -float("inf") and max(leads) - second < min(leads) > most + second)
            or (stamp > last + PAUSE * second > -float("inf") and later[1] - stamp < PAUSE * second)
        ):
            moved = 2 * stamp - last - later[0]  # beyond one interval
            offset -= moved
            stamp = raw + offset
            fault = f"the clock was set by {moved / second:+.3f} s, its stamps are followed"
        elif stamp <= last:
            fault = f"at {raw / second:.6f} s, not after {last / second:.6f} s, skipped"
        elif len(later) > 1 and last < later[0] < later[1] < stamp:
            fault = f"at {raw / second:.6f} s, after the stamps that follow, skipped"
        dropped = fault.endswith("skipped")
        last, most = last if dropped else stamp, most if fault else max(most, leads[0])
        yield None if dropped else stamp, sample, fault
