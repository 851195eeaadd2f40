"""Plain shapes of a drawing, places of its texts, and the drawing as SVG or PNG. Pixels: right, then down."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.frame import png
from edgemap.runtime.frames.reading import printable

TEXT_PX = 13.0  # height of the text
_GAP = 8.0
MAXIMUM_PLACED = 300  # texts that avoid each other: half a second

Box = tuple[float, float, float, float]
Points = NDArray[np.float64]
MAXIMUM_SHAPES = 5000  # objects, sightings or poses of one drawing or parameter file: some seconds
INK, PAPER = "#22272e", "#ffffff"
PNG_SCALE, SUBPIXEL_BITS = 2, 4  # pixels of a PNG for each of the drawing; fractions of a pixel that OpenCV takes


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
        wide = len(text) * TEXT_PX * 0.56  # the usual width of a letter against its height
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


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A polygon, or a line where it is open. points: (N, 2) px. fill, stroke: `#rrggbb`, empty for none. opacity: of
    both, 0..1. width: of the stroke, px."""

    points: Points
    fill: str = ""
    stroke: str = ""
    opacity: float = 1.0
    width: float = 1.5
    closed: bool = True


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text with a halo. x, y: its anchor on the baseline, px. anchor: start, middle or end."""

    text: str
    x: float
    y: float
    anchor: str = "start"
    colour: str = INK


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """A picture in the drawing. pixels: (H, W, 4) blue, green, red, opacity. The rest: its place, px."""

    pixels: NDArray[np.uint8]
    x: float
    y: float
    width: float
    height: float


Item = Shape | Text | Raster


def svg_of(items: Sequence[Item], width: float, height: float, title: str) -> str:
    """The drawing as SVG text that asks for nothing else."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(printable(title))}"><style>text{{font:{TEXT_PX:.0f}px system-ui,sans-serif;'
        f"paint-order:stroke;stroke:{PAPER};stroke-width:3px}}path{{stroke-linejoin:round}}</style>"
        f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    )
    return head + "".join(_element(item) for item in items) + "</svg>\n"


def _element(item: Item) -> str:
    if isinstance(item, Text):
        place = f'x="{item.x:.1f}" y="{item.y:.1f}" text-anchor="{item.anchor}" fill="{item.colour}"'
        return f"<text {place}>{escape(printable(item.text))}</text>"
    if isinstance(item, Raster):
        place = f'x="{item.x:.1f}" y="{item.y:.1f}" width="{item.width:.1f}" height="{item.height:.1f}"'
        address = "data:image/png;base64," + b64encode(png(item.pixels)).decode()
        return f'<image {place} preserveAspectRatio="none" style="image-rendering:pixelated" href="{address}"/>'
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in item.points.tolist()) + ("Z" if item.closed else "")
    style = f'fill="{item.fill or "none"}"'
    if item.stroke:
        style += f' stroke="{item.stroke}" stroke-width="{item.width:g}"'
    style += f' opacity="{item.opacity:g}"' if item.opacity < 1.0 else ""
    return f'<path d="{path}" {style}/>'


def picture_of(items: Sequence[Item], width: float, height: float) -> NDArray[np.uint8]:
    """The drawing as a BGR picture, `PNG_SCALE` times as large."""
    canvas = np.full((round(height * PNG_SCALE), round(width * PNG_SCALE), 3), 255, np.uint8)
    for item in items:
        if isinstance(item, Text):
            _write(canvas, item)
        elif isinstance(item, Raster):
            _lay(canvas, item)
        else:
            _paint(canvas, item)
    return canvas


def _paint(canvas: NDArray[np.uint8], shape: Shape) -> None:
    """Paints a shape over the part of the canvas that it covers."""
    points, margin = shape.points * PNG_SCALE, shape.width * PNG_SCALE + 2.0
    limits = np.array(canvas.shape[1::-1])
    low = np.clip(np.floor(points.min(axis=0) - margin), 0, limits).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + margin), 0, limits).astype(int)
    if (high <= low).any():
        return
    part = canvas[low[1] : high[1], low[0] : high[0]]
    painted = part.copy()
    corners = np.round((points - low) * 2**SUBPIXEL_BITS).astype(np.int32)
    if shape.fill:
        cv2.fillPoly(painted, [corners], bgr(shape.fill), cv2.LINE_AA, SUBPIXEL_BITS)
    if shape.stroke:
        thickness = max(1, round(shape.width * PNG_SCALE))
        cv2.polylines(painted, [corners], shape.closed, bgr(shape.stroke), thickness, cv2.LINE_AA, SUBPIXEL_BITS)
    cv2.addWeighted(painted, shape.opacity, part, 1.0 - shape.opacity, 0.0, dst=part)


def _write(canvas: NDArray[np.uint8], text: Text) -> None:
    scale = TEXT_PX * PNG_SCALE / 30.0  # of OpenCV's letters, which are 30 px high with their descenders
    (wide, _), _ = cv2.getTextSize(words := printable(text.text), cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    left = text.x * PNG_SCALE - {"start": 0.0, "middle": 0.5, "end": 1.0}[text.anchor] * wide
    place = round(left), round(text.y * PNG_SCALE)
    halo = [(right, down, PAPER) for right in (-2, 0, 2) for down in (-2, 0, 2)]
    for right, down, colour in [*halo, (0, 0, text.colour)]:
        at = (place[0] + right, place[1] + down)
        cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, scale, bgr(colour), 1, cv2.LINE_AA)


def _lay(canvas: NDArray[np.uint8], raster: Raster) -> None:
    """Draws a picture that lies within the canvas."""
    left, top, right, bottom = (
        round(v * PNG_SCALE) for v in (raster.x, raster.y, raster.x + raster.width, raster.y + raster.height)
    )
    part = canvas[max(top, 0) : bottom, max(left, 0) : right]
    size = (max(right - left, 1), max(bottom - top, 1))
    pixels = cv2.resize(raster.pixels, size, interpolation=cv2.INTER_NEAREST)[max(-top, 0) :, max(-left, 0) :]
    pixels = pixels[: part.shape[0], : part.shape[1]]
    opacity = pixels[..., 3:] / 255.0
    part[:] = np.round(opacity * pixels[..., :3] + (1.0 - opacity) * part)


def bgr(colour: str) -> tuple[int, int, int]:
    """`#rrggbb` as OpenCV takes it."""
    red, green, blue = bytes.fromhex(colour[1:])
    return blue, green, red
