"""Tables of numbers as text, separated by commas or spaces: read by numpy, checked against their columns."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.faults import note_dropped
from edgemap.runtime.frames.limits import LINE, VALUES
from edgemap.runtime.frames.reading import one_line, read_bytes
from edgemap.runtime.frames.stamps import followed


@dataclass(frozen=True, slots=True)
class Column:
    """A column's name, unit included, and the closed range that its numbers lie in."""

    name: str
    minimum: float = -1e6
    maximum: float = 1e6


STAMP = Column("stamp_s", -1e12, 1e12)


def columns(names: str, minimum: float = -1e6, maximum: float = 1e6) -> tuple[Column, ...]:
    """Columns of one range from their names, separated by spaces."""
    return tuple(Column(name, minimum, maximum) for name in names.split())


@dataclass(frozen=True, slots=True)
class NumberTable:
    """A table's columns. header: whether the first line names them. samples: whether its rows are samples, the first
    column their stamps: those that are none are dropped and counted, and a clock that was set is followed
    (`followed`). Lines that start with # are comments; a byte order mark is read.
    """

    columns: tuple[Column, ...]
    header: bool = False
    samples: bool = False

    def read(self, path: Path, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Line numbers, and the rows as (N, columns). Raises `error`, also for an empty table."""
        return self.parse(read_bytes(path, error), str(path), error)

    def parse(self, data: bytes, path: str, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Parses the bytes of a file as `read` does. path: for messages."""
        names = [column.name for column in self.columns]
        if (count := data.count(b"\n")) > VALUES // 2:
            raise error(f"{path}: {count:,} lines, at most {VALUES // 2:,} are read")
        lines = data.decode("utf-8-sig", "replace").replace(",", " ").split("\n")
        if (longest := max(map(len, lines))) > LINE:
            raise error(f"{path}: a line of {longest:,} characters, at most {LINE:,} are read")
        if self.header and lines[0].split() != names:
            raise error(f"{path}: first line must be {','.join(names)}")
        texts = {at: line for at, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")}
        if self.header:
            del texts[1]
        if not texts:
            raise error(f"{path}: no rows of numbers in it")
        numbers, rows, wrong = list(texts), np.full((len(texts), len(names)), np.nan), dict[int, str]()
        for at, text in enumerate(texts.values()):
            try:
                rows[at] = np.array([float(word) for word in text.split()]).reshape(len(names))
            except ValueError:
                expected = f"expected {len(names)} finite numbers a line, {' '.join(names)}"
                wrong[at] = f"{numbers[at]}: {one_line(text, 40)!r}, {expected}"
        for column, values in zip(self.columns, rows.T, strict=True):
            for at in np.flatnonzero(~((column.minimum <= values) & (values <= column.maximum))):  # NaN too
                why = f"{column.name} is {values[at]:g}, must be {column.minimum:g} to {column.maximum:g}"
                wrong.setdefault(int(at), f"{numbers[at]}: {why}")
        if self.samples:
            return self._in_order(path, error, numbers, rows, wrong)
        if wrong:
            raise error(f"{path}:{next(iter(wrong.values()))}")
        return numbers, rows

    def _in_order(
        self, path: str, error: type[EdgemapError], numbers: list[int], rows: NDArray[np.float64], wrong: dict[int, str]
    ) -> tuple[list[int], NDArray[np.float64]]:
        """The rows that are samples, at stamps that increase. Raises `error` where half of the rows are none."""
        good, reasons = list[int](), list(wrong.values())
        stamps = ((float(rows[at, 0]), at) for at in range(len(rows)) if at not in wrong)
        for stamp_s, at, fault in followed(stamps, 10**9 if self.columns[0].name.endswith("_ns") else 1):
            reasons += [f"{numbers[at]}: {fault}"] if fault else []
            if stamp_s is not None:
                rows[at, 0] = stamp_s
                good.append(at)
        if 2 * len(good) <= len(rows) and reasons:
            raise error(f"{path}:{reasons[0]} ({len(rows) - len(good)} of {len(rows)} lines are no samples)")
        note_dropped(path, [f"line {reason}" for reason in reasons], len(rows))
        return [numbers[at] for at in good], rows[good]
