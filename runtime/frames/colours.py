"""One mark per label, a shape in a colour: the same on the live page, in figures and in reports."""

import math
from dataclasses import dataclass
from zlib import crc32

Polygon = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Mark:
    """shape: a key of `SHAPES`. colour: `#rrggbb`."""

    shape: str
    colour: str


def _around(part: Polygon, times: int, by_rad: float = 0.0) -> Polygon:
    """A polygon of equal parts around its centre. part: the corners of one of them."""
    turns = [(math.cos(turn), math.sin(turn)) for turn in (by_rad + math.tau * k / times for k in range(times))]
    return tuple((c * x - s * y, s * x + c * y) for c, s in turns for x, y in part)


# Corners (right, down) about the centre, in units of a circle's radius with about the same ink; none for the circle.
SHAPES: dict[str, Polygon] = {
    "circle": (),
    "square": _around(((-0.9, -0.9),), 4),
    "triangle": _around(((0.0, -1.3),), 3),
    "diamond": _around(((0.0, -1.3), (1.05, 0.0)), 2),
    "wedge": _around(((0.0, 1.3),), 3),
    "plus": _around(((-0.42, -1.2), (0.42, -1.2), (0.42, -0.42)), 4),
    "star": _around(((0.0, -1.4), (0.353, -0.485)), 5),
    "cross": _around(((-0.42, -1.2), (0.42, -1.2), (0.42, -0.42)), 4, math.pi / 4.0),
}

# Two sets of three colours, each 3:1 against white and against the dark page's cards (WCAG 2.2, 1.4.11). Within a set
# they stay apart for every kind of colour blindness, so two marks differ by shape or by a colour that all can see.
_SETS = (("#0072b2", "#857a00", "#d0255f"), ("#c77700", "#2f8a7a", "#7766cc"))
MARKS = tuple(
    Mark(shape, _SETS[number % 2][(number // 2 + shift) % 3])
    for shift in range(3)
    for number, shape in enumerate(SHAPES)
)

# Classes that bundles map by default have marks of their own; other labels may share one, beside their name.
USUAL = (
    "chair", "couch", "potted plant", "bed", "dining table", "tv", "refrigerator", "toilet", "suitcase", "backpack",
    "bench", "oven", "sink", "vase", "bicycle", "car", "motorcycle", "bus", "train", "truck", "fire hydrant",
    "stop sign", "parking meter",
)  # fmt: skip


def label_mark(label: str) -> Mark:
    """The mark of a label; depends on the label alone."""
    return MARKS[
        USUAL.index(label) if label in USUAL else crc32(label.encode("utf-8", "backslashreplace")) % len(MARKS)
    ]


def label_rgb(label: str) -> tuple[float, float, float]:
    """The colour of a label's mark, each part 0..1."""
    red, green, blue = (value / 255.0 for value in bytes.fromhex(label_mark(label).colour[1:]))
    return red, green, blue
