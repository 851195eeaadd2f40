"""Reads Darknet's cfg files: sections with options, each remembered with its line for messages."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import one_line, read_text

CFG_BYTES = 1 << 20
SECTION_LIMIT = 2000
OPTION_LENGTH = 10_000
LARGEST = 100_000  # of any whole number: pixels, channels, layers; more has no meaning and takes memory
Value = TypeVar("Value", int, float)
_REQUIRED = object()


@dataclass(frozen=True)
class Section:
    """One `[kind]` block of a cfg. file, line: its position. options: key to (text, line)."""

    kind: str
    file: str
    line: int
    options: dict[str, tuple[str, int]] = field(default_factory=dict)

    @property
    def where(self) -> str:
        """`file:line: [kind]`, the start of every message about this section."""
        return f"{self.file}:{self.line}: [{self.kind}]"

    def text(self, key: str, default: str | None = None) -> str:
        """An option's text. Raises ExportError where it is missing and has no default."""
        if key in self.options:
            return self.options[key][0]
        if default is None:
            raise ExportError(f"{self.where} lacks {key}=")
        return default

    def integer(self, key: str, default: object = _REQUIRED, least: int | None = None) -> int:
        """An option as a whole number, at least `least`. Raises ExportError."""
        return self._one(key, default, int, "a whole number", least)

    def number(self, key: str, default: object = _REQUIRED) -> float:
        """An option as a real number. Raises ExportError."""
        return self._one(key, default, float, "a number", None)

    def integers(self, key: str) -> tuple[int, ...]:
        """A comma-separated option as whole numbers. Raises ExportError."""
        return tuple(self._list(key, int, "whole numbers"))

    def numbers(self, key: str) -> tuple[float, ...]:
        """A comma-separated option as real numbers. Raises ExportError."""
        return tuple(self._list(key, float, "numbers"))

    def _one(self, key: str, default: object, read: Callable[[str], Value], what: str, least: int | None) -> Value:
        if key not in self.options and default is not _REQUIRED:
            return default  # type: ignore[return-value]
        text = self.text(key)
        try:
            value = read(text)
        except ValueError:
            raise ExportError(f"{self.file}:{self.options[key][1]}: {key}={one_line(text, 60)} is not {what}") from None
        self._in_range(key, value)
        if least is not None and value < least:
            raise ExportError(f"{self.file}:{self.options[key][1]}: {key}={text}, expected {least} or more")
        return value

    def _in_range(self, key: str, value: float) -> None:
        if not abs(value) <= LARGEST:
            where = f"{self.file}:{self.options[key][1]}"
            raise ExportError(f"{where}: {key}={one_line(self.text(key), 40)}, at most {LARGEST:,} are read")

    def _list(self, key: str, read: Callable[[str], Value], what: str) -> list[Value]:
        text = self.text(key)
        try:
            values = [read(part) for part in text.split(",") if part.strip()]
            for value in values:
                self._in_range(key, value)
            return values
        except ValueError:
            raise ExportError(
                f"{self.file}:{self.options[key][1]}: {key}={one_line(text, 60)} is not a list of {what}"
            ) from None


def parse_cfg(text: str, file: str = "cfg") -> list[Section]:
    """Split a cfg into sections, `[net]` first. Of a key given twice the first counts. Raises ExportError."""
    sections: list[Section] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split("#", 1)[0].split(";", 1)[0].strip()
        if not line:
            continue
        if line.startswith("["):
            if not line.endswith("]"):
                raise ExportError(f"{file}:{number}: {one_line(line, 60)!r} has no closing bracket")
            if len(sections) == SECTION_LIMIT:
                raise ExportError(f"{file}:{number}: more than {SECTION_LIMIT:,} sections")
            sections.append(Section(one_line(line[1:-1].strip().lower(), 40), file, number))
            continue
        key, equals, value = line.partition("=")
        if not equals:
            raise ExportError(f"{file}:{number}: {one_line(line, 60)!r} is neither [section] nor key=value")
        if not sections:
            raise ExportError(f"{file}:{number}: {one_line(key, 40)}= stands before any [section]")
        sections[-1].options.setdefault(one_line(key, 100), (one_line(value, OPTION_LENGTH), number))
    if not sections or sections[0].kind not in ("net", "network"):
        raise ExportError(f"{file}: does not start with [net]: not a Darknet cfg")
    if len(sections) == 1:
        raise ExportError(f"{file}: [net] without any layer")
    return sections


def read_cfg(path: Path) -> list[Section]:
    """Read a cfg file. Raises ExportError where it cannot be read or parsed."""
    return parse_cfg(read_text(path, CFG_BYTES, ExportError), path.name)
