"""Text tables of numbers: CSV and space-separated lines, checked line by line against their columns."""

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import one_line, read_bytes

TABLE_BYTES = 128 << 20
ROW_LIMIT = 2_000_000  # eleven hours at 50 Hz
LINE_LENGTH = 4096
SHOWN = 60


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
    """A table's layout. separator: None for white space or commas. header: whether the first line names the columns.
    Lines that start with # are comments."""

    columns: tuple[Column, ...]
    separator: str | None = None
    header: bool = False

    def read(self, path: Path, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Line numbers, and the rows as (N, columns). Raises `error` with the line number, also for an empty table."""
        return self.parse(read_bytes(path, TABLE_BYTES, error), str(path), error)

    def parse(self, data: bytes, path: str, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Parses the bytes of a file as `read` does. path: for messages."""
        numbers: list[int] = []
        values = array("d")  # a list would take four times the memory
        for number, line in self._lines(data, path, error):
            if len(numbers) == ROW_LIMIT:
                raise error(f"{path}: more than {ROW_LIMIT:,} rows")
            values.extend(self._row(line, f"{path}:{number}", error))
            numbers.append(number)
        if not numbers:
            raise error(f"{path}: no rows of numbers in it")
        return numbers, np.frombuffer(values).reshape(-1, len(self.columns))

    def _lines(self, data: bytes, path: str, error: type[EdgemapError]) -> Iterator[tuple[int, str]]:
        names = (self.separator or " ").join(column.name for column in self.columns)
        for number, raw in enumerate(BytesIO(data), start=1):
            if len(raw) > LINE_LENGTH:
                raise error(f"{path}:{number}: a line of {len(raw):,} bytes, at most {LINE_LENGTH:,} are read")
            try:
                line = raw.decode("utf-8").strip()
            except UnicodeDecodeError as why:
                raise error(f"{path}:{number}: cannot be read ({one_line(why)})") from None
            if number == 1 and self.header:
                if [word.strip() for word in line.split(self.separator)] != [column.name for column in self.columns]:
                    raise error(f"{path}: first line must be {names}")
            elif line and not line.startswith("#"):
                yield number, line

    def _row(self, line: str, where: str, error: type[EdgemapError]) -> list[float]:
        words = line.split(self.separator) if self.separator else line.replace(",", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != len(self.columns) or not all(map(math.isfinite, row)):
            names = " ".join(column.name for column in self.columns)
            count = len(self.columns)
            raise error(f"{where}: expected {count} finite numbers, {names}, found {one_line(line, SHOWN)!r}")
        for column, value in zip(self.columns, row, strict=True):
            if not column.minimum <= value <= column.maximum:
                raise error(f"{where}: {column.name} is {value:g}, must be {column.minimum:g} to {column.maximum:g}")
        return row
