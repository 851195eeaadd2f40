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
MAXIMUM_PLACED = 300  # texts that avoid each other: the work grows with the square

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
    if len(marks) > MAXIMUM_PLACED:
        return [_spots(x, y)[0] for _, x, y in marks]
    taken = np.array([(x - 5, y - 5, x + 5, y + 5) for _, x, y in marks])  # boxes: left, top, right, bottom
    placed = []
    for text, x, y in marks:
        wide, spots = len(text) * TEXT_PX * 0.56, _spots(x, y)  # the usual width of a letter against its height
        left, base = np.array([(right - _share_left(anchor) * wide, down) for right, down, anchor in spots]).T
        boxes = np.column_stack([left, base - 0.85 * TEXT_PX, left + wide, base + 0.25 * TEXT_PX])
        shared = np.minimum(boxes[:, None, 2:], taken[:, 2:]) - np.maximum(boxes[:, None, :2], taken[:, :2])
        outside = np.concatenate([-boxes[:, :2], boxes[:, 2:] - (width_px, height_px)], axis=1)
        over, outside = (np.maximum(one, 0.0) for one in (shared, outside))
        costs = over.prod(axis=2).sum(axis=1) + 60.0 * outside.sum(axis=1) + 4.0 * np.arange(len(spots))
        best = int(costs.argmin())
        taken = np.vstack([taken, boxes[best]])
        placed.append(spots[best])
    return placed


def _spots(x: float, y: float) -> list[tuple[float, float, str]]:
    """Eight places, the most usual first."""
    level, above, below = y + 0.35 * TEXT_PX, y - _GAP, y + _GAP + 0.8 * TEXT_PX
    return [
        (x + _GAP, level, "start"), (x + 5, above, "start"), (x + 5, below, "start"), (x - _GAP, level, "end"),
        (x - 5, above, "end"), (x - 5, below, "end"), (x, above - 2, "middle"), (x, below + 2, "middle"),
    ]  # fmt: skip


def _share_left(anchor: str) -> float:
    """Which share of a text is left of its place, by SVG's text-anchor."""
    return {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor]


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

    def svg(self) -> str:
        """It as an element of SVG."""
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self.points.tolist()) + ("Z" if self.closed else "")
        style = f'fill="{self.fill or "none"}"'
        style += f' stroke="{self.stroke}" stroke-width="{self.width:g}"' if self.stroke else ""
        style += f' opacity="{self.opacity:g}"' if self.opacity < 1.0 else ""
        return f'<path d="{path}" {style}/>'

    def paint(self, canvas: NDArray[np.uint8]) -> None:
        """Paints it over the part of the canvas that it covers."""
        points, margin, limits = self.points * PNG_SCALE, self.width * PNG_SCALE + 2.0, np.array(canvas.shape[1::-1])
        low = np.clip(np.floor(points.min(axis=0) - margin), 0, limits).astype(int)
        high = np.clip(np.ceil(points.max(axis=0) + margin), 0, limits).astype(int)
        if (high <= low).any():
            return
        part = canvas[low[1] : high[1], low[0] : high[0]]
        painted = part.copy()
        corners = np.round((points - low) * 2**SUBPIXEL_BITS).astype(np.int32)
        if self.fill:
            cv2.fillPoly(painted, [corners], bgr(self.fill), cv2.LINE_AA, SUBPIXEL_BITS)
        if self.stroke:
            thickness = max(1, round(self.width * PNG_SCALE))
            cv2.polylines(painted, [corners], self.closed, bgr(self.stroke), thickness, cv2.LINE_AA, SUBPIXEL_BITS)
        cv2.addWeighted(painted, self.opacity, part, 1.0 - self.opacity, 0.0, dst=part)


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text with a halo. x, y: its anchor on the baseline, px. anchor: start, middle or end."""

    text: str
    x: float
    y: float
    anchor: str = "start"
    colour: str = INK

    def svg(self) -> str:
        """It as an element of SVG."""
        place = f'x="{self.x:.1f}" y="{self.y:.1f}" text-anchor="{self.anchor}" fill="{self.colour}"'
        return f"<text {place}>{escape(printable(self.text))}</text>"

    def paint(self, canvas: NDArray[np.uint8]) -> None:
        """Writes it on the canvas."""
        scale = TEXT_PX * PNG_SCALE / 30.0  # of OpenCV's letters, which are 30 px high with their descenders
        (wide, _), _ = cv2.getTextSize(words := printable(self.text), cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
        left, base = round(self.x * PNG_SCALE - _share_left(self.anchor) * wide), round(self.y * PNG_SCALE)
        halo = [(right, down, PAPER) for right in (-2, 0, 2) for down in (-2, 0, 2)]
        for right, down, colour in [*halo, (0, 0, self.colour)]:
            at = (left + right, base + down)
            cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, scale, bgr(colour), 1, cv2.LINE_AA)


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """A picture in the drawing. pixels: (H, W, 4) blue, green, red, opacity. The rest: its place, px."""

    pixels: NDArray[np.uint8]
    x: float
    y: float
    width: float
    height: float

    def svg(self) -> str:
        """It as an element of SVG."""
        place = f'x="{self.x:.1f}" y="{self.y:.1f}" width="{self.width:.1f}" height="{self.height:.1f}"'
        address = "data:image/png;base64," + b64encode(png(self.pixels)).decode()
        return f'<image {place} preserveAspectRatio="none" style="image-rendering:pixelated" href="{address}"/>'

    def paint(self, canvas: NDArray[np.uint8]) -> None:
        """Lays what lies within the canvas on it."""
        corners = np.array([self.x, self.y, self.x + self.width, self.y + self.height])
        left, top, right, bottom = np.round(corners * PNG_SCALE).astype(int).tolist()
        part = canvas[max(top, 0) : bottom, max(left, 0) : right]
        size = (max(right - left, 1), max(bottom - top, 1))
        pixels = cv2.resize(self.pixels, size, interpolation=cv2.INTER_NEAREST)[max(-top, 0) :, max(-left, 0) :]
        pixels = pixels[: part.shape[0], : part.shape[1]]
        opacity = pixels[..., 3:] / 255.0
        part[:] = np.round(opacity * pixels[..., :3] + (1.0 - opacity) * part)


Item = Shape | Text | Raster


def svg_of(items: Sequence[Item], width: float, height: float, title: str) -> str:
    """The drawing as SVG text that asks for nothing else."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(printable(title))}"><style>text{{font:{TEXT_PX:.0f}px system-ui,sans-serif;'
        f"paint-order:stroke;stroke:{PAPER};stroke-width:3px}}path{{stroke-linejoin:round}}</style>"
        f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    )
    return head + "".join(item.svg() for item in items) + "</svg>\n"


def picture_of(items: Sequence[Item], width: float, height: float) -> NDArray[np.uint8]:
    """The drawing as a BGR picture, `PNG_SCALE` times as large."""
    canvas = np.full((round(height * PNG_SCALE), round(width * PNG_SCALE), 3), 255, np.uint8)
    for item in items:
        item.paint(canvas)
    return canvas


def bgr(colour: str) -> tuple[int, int, int]:
    """`#rrggbb` as OpenCV takes it."""
    red, green, blue = bytes.fromhex(colour[1:])
    return blue, green, red
