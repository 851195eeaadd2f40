"""Places labels next to their dots with little overlap."""

from collections.abc import Sequence

TEXT_PX, WIDTH_SHARE = 13.0, 0.56  # height of the text; usual width of a letter against it
_GAP = 8.0
MAXIMUM_PLACED = 300  # texts that avoid each other: half a second

Box = tuple[float, float, float, float]


def place_labels(
    marks: Sequence[tuple[str, float, float]], width_px: float, height_px: float
) -> list[tuple[float, float, str]]:
    """Positions of the texts (text, x, y) next to their dots: x, baseline y and SVG's text-anchor of each.

    Greedy: of eight places around its dot each text takes the one that overlaps least with dots, earlier texts and the
    border. Beyond `MAXIMUM_PLACED` texts all are placed to the right of their dots.
    """
    if len(marks) > MAXIMUM_PLACED:  # the work grows with the square: all to the right of their dots
        return [_spots(x, y)[0] for _, x, y in marks]
    taken: list[Box] = [(x - 5, y - 5, x + 5, y + 5) for _, x, y in marks]
    placed = []
    for text, x, y in marks:
        wide = len(text) * TEXT_PX * WIDTH_SHARE
        best = min(
            (_cost(spot, wide, rank, taken, width_px, height_px), rank, spot) for rank, spot in enumerate(_spots(x, y))
        )[2]
        taken.append(_box(best, wide))
        placed.append(best)
    return placed


def _spots(x: float, y: float) -> list[tuple[float, float, str]]:
    """Eight places, the most usual first."""
    level, above, below = y + 0.35 * TEXT_PX, y - _GAP, y + _GAP + 0.8 * TEXT_PX
    return [
        (x + _GAP, level, "start"), (x + 5, above, "start"), (x + 5, below, "start"), (x - _GAP, level, "end"),
        (x - 5, above, "end"), (x - 5, below, "end"), (x, above - 2, "middle"), (x, below + 2, "middle"),
    ]  # fmt: skip


def _box(spot: tuple[float, float, str], wide: float) -> Box:
    x, y, anchor = spot
    left = x - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * wide
    return (left, y - 0.85 * TEXT_PX, left + wide, y + 0.25 * TEXT_PX)


def _cost(
    spot: tuple[float, float, str], wide: float, rank: int, taken: list[Box], width_px: float, height_px: float
) -> float:
    x0, y0, x1, y1 = _box(spot, wide)
    over = sum(max(0.0, min(x1, b[2]) - max(x0, b[0])) * max(0.0, min(y1, b[3]) - max(y0, b[1])) for b in taken)
    outside = max(0.0, -x0) + max(0.0, x1 - width_px) + max(0.0, -y0) + max(0.0, y1 - height_px)
    return over + 60.0 * outside + 4.0 * rank
