"""Reads Darknet's cfg files: sections with options, each remembered with its line for messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from edgemap.export.errors import ExportError

Value = TypeVar("Value", int, float)
_REQUIRED = object()


@dataclass(frozen=True)
class Section:
    """One `[kind]` block of a cfg. file, line: where it stands. options: key to (text, line)."""

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
            raise ExportError(f"{self.file}:{self.options[key][1]}: {key}={text} is not {what}") from None
        if least is not None and value < least:
            raise ExportError(f"{self.file}:{self.options[key][1]}: {key}={text}, expected {least} or more")
        return value

    def _list(self, key: str, read: Callable[[str], Value], what: str) -> list[Value]:
        text = self.text(key)
        try:
            return [read(part) for part in text.split(",") if part.strip()]
        except ValueError:
            raise ExportError(f"{self.file}:{self.options[key][1]}: {key}={text} is not a list of {what}") from None


def parse_cfg(text: str, file: str = "cfg") -> list[Section]:
    """Split a cfg into sections, `[net]` first. Of a key given twice the first counts. Raises ExportError."""
    sections: list[Section] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split("#", 1)[0].split(";", 1)[0].strip()
        if not line:
            continue
        if line.startswith("["):
            if not line.endswith("]"):
                raise ExportError(f"{file}:{number}: {line!r} has no closing bracket")
            sections.append(Section(line[1:-1].strip().lower(), file, number))
            continue
        key, equals, value = line.partition("=")
        if not equals:
            raise ExportError(f"{file}:{number}: {line[:60]!r} is neither [section] nor key=value")
        if not sections:
            raise ExportError(f"{file}:{number}: {key.strip()}= stands before any [section]")
        sections[-1].options.setdefault(key.strip(), (value.strip(), number))
    if not sections or sections[0].kind not in ("net", "network"):
        raise ExportError(f"{file}: does not start with [net]: not a Darknet cfg")
    if len(sections) == 1:
        raise ExportError(f"{file}: [net] without any layer")
    return sections


def read_cfg(path: Path) -> list[Section]:
    """Read a cfg file. Raises ExportError where it cannot be read or parsed."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ExportError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ExportError(f"{path}: not text, so not a Darknet cfg") from None
    return parse_cfg(text, path.name)
