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


def _rotated(polygon: Polygon, by_rad: float) -> Polygon:
    c, s = math.cos(by_rad), math.sin(by_rad)
    return tuple((c * x - s * y, s * x + c * y) for x, y in polygon)


def _star(points: int, inner: float, outer: float) -> Polygon:
    polar = ((math.pi * k / points - math.pi / 2, inner if k % 2 else outer) for k in range(2 * points))
    return tuple((radius * math.cos(angle), radius * math.sin(angle)) for angle, radius in polar)


_ARM, _REACH = 0.42, 1.2
_PLUS: Polygon = (
    (-_ARM, -_REACH), (_ARM, -_REACH), (_ARM, -_ARM), (_REACH, -_ARM), (_REACH, _ARM), (_ARM, _ARM),
    (_ARM, _REACH), (-_ARM, _REACH), (-_ARM, _ARM), (-_REACH, _ARM), (-_REACH, -_ARM), (-_ARM, -_ARM),
)  # fmt: skip
_TRIANGLE: Polygon = ((0.0, -1.25), (1.2, 0.85), (-1.2, 0.85))

# Corners (right, down) about the centre, in units of a circle's radius with about the same ink; none for the circle.
SHAPES: dict[str, Polygon] = {
    "circle": (),
    "square": ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "triangle": _TRIANGLE,
    "diamond": ((0.0, -1.3), (1.05, 0.0), (0.0, 1.3), (-1.05, 0.0)),
    "wedge": tuple((x, -y) for x, y in _TRIANGLE),
    "plus": _PLUS,
    "star": _star(5, 0.6, 1.4),
    "cross": _rotated(_PLUS, math.pi / 4),
}

# Two sets of three colours, each 3:1 against white and against the dark page's cards (WCAG 2.2, 1.4.11). Within a set
# they stay apart for every kind of colour blindness, so two marks differ by shape or by a colour that all can see.
_SETS = (("#0072b2", "#857a00", "#d0255f"), ("#c77700", "#2f8a7a", "#7766cc"))
MARKS = tuple(
    Mark(shape, _SETS[number % 2][(number // 2 + shift) % 3])
    for shift in range(3)
    for number, shape in enumerate(SHAPES)
)
PALETTE = _SETS[0] + _SETS[1]

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
    red, green, blue = (value / 255.0 for value in bytes.fromhex(label_colour(label)[1:]))
    return red, green, blue


def label_colour(label: str) -> str:
    """The colour of a label's mark as `#rrggbb`."""
    return label_mark(label).colour
