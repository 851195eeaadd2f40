"""Darknet's cfg files: sections with options, each remembered with its line; and those of YOLOv3 and YOLOv3-tiny."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import one_line

SECTION_LIMIT = 2000
OPTION_LENGTH = 10_000
LARGEST = 100_000  # of any whole number: pixels, channels, layers; more has no meaning and takes memory
Value = TypeVar("Value", int, float)


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

    def integer(self, key: str, default: int | None = None, least: int = -LARGEST) -> int:
        """An option as a whole number, at least `least`. Raises ExportError, also where it lacks without a default."""
        if key not in self.options and default is not None:
            return default
        (value,) = self._read(key, [self.text(key)], int, "a whole number")
        if value < least:
            raise ExportError(f"{self._where(key)}={value}, expected {least} or more")
        return value

    def number(self, key: str, default: float) -> float:
        """An option as a real number. Raises ExportError."""
        return self._read(key, [self.text(key)], float, "a number")[0] if key in self.options else default

    def numbers(self, key: str, read: Callable[[str], Value]) -> tuple[Value, ...]:
        """A comma-separated option as whole (`int`) or real (`float`) numbers. Raises ExportError."""
        parts = [part for part in self.text(key).split(",") if part.strip()]
        return self._read(key, parts, read, "a list of whole numbers" if read is int else "a list of numbers")

    def _read(self, key: str, parts: list[str], read: Callable[[str], Value], what: str) -> tuple[Value, ...]:
        try:
            values = tuple(map(read, parts))
        except ValueError:
            raise ExportError(f"{self._where(key)}={one_line(self.text(key), 60)} is not {what}") from None
        if not all(abs(value) <= LARGEST for value in values):
            raise ExportError(f"{self._where(key)}={one_line(self.text(key), 40)}, at most {LARGEST:,} are read")
        return values

    def _where(self, key: str) -> str:
        return f"{self.file}:{self.options[key][1]}: {key}"


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


TINY_ANCHORS = "10,14, 23,27, 37,58, 81,82, 135,169, 344,319"
FULL_ANCHORS = "10,13, 16,30, 33,23, 30,61, 62,45, 59,119, 116,90, 156,198, 373,326"
CLASSES = 80


def _section(kind: str, **options: object) -> str:
    return f"[{kind}]\n" + "".join(f"{key.rstrip('_')}={value}\n" for key, value in options.items())


NET = _section("net", width=416, height=416, channels=3)


def _conv(filters: int, size: int, stride: int = 1) -> str:
    return _section(
        "convolutional", batch_normalize=1, filters=filters, size=size, stride=stride, pad=1, activation="leaky"
    )


def _head(mask: str, anchors: str) -> str:
    filters = 3 * (CLASSES + 5)
    conv = _section("convolutional", size=1, stride=1, pad=1, filters=filters, activation="linear")
    return conv + _section("yolo", mask=mask, anchors=anchors, classes=CLASSES, num=anchors.count(",") // 2 + 1)


def _finer(branch: int, join: int, filters: int) -> str:
    """From a branch point to the next finer grid, joined with an earlier layer of that grid."""
    return (
        _section("route", layers=branch)
        + _conv(filters, 1)
        + _section("upsample", stride=2)
        + _section("route", layers=f"-1, {join}")
    )


def yolov3_tiny() -> str:
    """Cfg text of YOLOv3-tiny: 24 layers, 8,858,734 values, heads of stride 32 and 16."""
    text = NET
    for filters, stride in ((16, 2), (32, 2), (64, 2), (128, 2), (256, 2), (512, 1)):
        text += _conv(filters, 3) + _section("maxpool", size=2, stride=stride)
    text += _conv(1024, 3) + _conv(256, 1) + _conv(512, 3) + _head("3,4,5", TINY_ANCHORS)
    return text + _finer(-4, 8, 128) + _conv(256, 3) + _head("0,1,2", TINY_ANCHORS)


def yolov3() -> str:
    """Cfg text of YOLOv3: Darknet-53 and three heads, 107 layers, 62,001,757 values, strides 32, 16 and 8."""
    text = NET + _conv(32, 3)
    for filters, blocks in ((64, 1), (128, 2), (256, 8), (512, 8), (1024, 4)):
        residual = _conv(filters // 2, 1) + _conv(filters, 3) + _section("shortcut", from_=-3, activation="linear")
        text += _conv(filters, 3, stride=2) + blocks * residual
    text += 3 * (_conv(512, 1) + _conv(1024, 3)) + _head("6,7,8", FULL_ANCHORS)
    text += _finer(-4, 61, 256) + 3 * (_conv(256, 1) + _conv(512, 3)) + _head("3,4,5", FULL_ANCHORS)
    return text + _finer(-4, 36, 128) + 3 * (_conv(128, 1) + _conv(256, 3)) + _head("0,1,2", FULL_ANCHORS)
