"""Tables of numbers as text, separated by commas or spaces: read by numpy, checked against their columns."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import one_line, read_bytes


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
    """A table's columns. header: whether the first line names them. Lines that start with # are comments."""

    columns: tuple[Column, ...]
    header: bool = False

    def read(self, path: Path, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Line numbers, and the rows as (N, columns). Raises `error`, also for an empty table."""
        return self.parse(read_bytes(path, error), str(path), error)

    def parse(self, data: bytes, path: str, error: type[EdgemapError]) -> tuple[list[int], NDArray[np.float64]]:
        """Parses the bytes of a file as `read` does. path: for messages."""
        names = [column.name for column in self.columns]
        lines = data.replace(b",", b" ").decode("utf-8", "replace").splitlines()
        if self.header and (not lines or lines.pop(0).split() != names):
            raise error(f"{path}: first line must be {','.join(names)}")
        numbers = [
            number
            for number, line in enumerate(lines, 1 + self.header)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        if not numbers:
            raise error(f"{path}: no rows of numbers in it")
        expected = f"expected {len(names)} finite numbers a line, {' '.join(names)}"
        try:
            rows = np.loadtxt([lines[number - 1 - self.header] for number in numbers], comments=None, ndmin=2)
        except ValueError as why:
            raise error(f"{path}: {expected} ({one_line(why)})") from None
        if rows.shape[1] != len(names):
            raise error(f"{path}: {expected}, found {rows.shape[1]}")
        for column, values in zip(self.columns, rows.T, strict=True):
            if len(wrong := np.flatnonzero(~((column.minimum <= values) & (values <= column.maximum)))):  # NaN too
                where, value = f"{path}:{numbers[wrong[0]]}", values[wrong[0]]
                raise error(f"{where}: {column.name} is {value:g}, must be {column.minimum:g} to {column.maximum:g}")
        return numbers, rows
