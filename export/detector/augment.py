"""Augmentation: mosaics of four pictures, scale, shift, flip, colour, blur, noise. Seeded by the caller."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from edgemap.export.detector.store import Example

PAD = 114  # grey of the letterbox, as YOLOX pads
MOSAIC_SCALES = (0.35, 1.15)  # of the canvas
SINGLE_SCALES = (0.6, 1.5)
STRETCH = (-0.1, 1.1)  # from as the picture is (0) to as wide as high (1)


def mosaic(examples: Sequence[Example], size: int, generator: Generator) -> Example:
    """Four pictures round a random point of a square canvas, each at its own scale."""
    centre = generator.uniform(0.3, 0.7, 2) * size
    placed = []
    for position, example in enumerate(examples):
        scale = _scale(example, size * generator.uniform(*MOSAIC_SCALES), generator)
        width, height = example.image.shape[1::-1] * scale
        corner = centre - [width * (position % 2 == 0), height * (position < 2)]
        x0, x1 = (0.0, centre[0]) if position % 2 == 0 else (centre[0], size)
        y0, y1 = (0.0, centre[1]) if position < 2 else (centre[1], size)
        placed.append((example, scale, corner, np.array([x0, y0, x1, y1])))
    return _composed(size, placed)


def single(example: Example, size: int, generator: Generator) -> Example:
    """One picture at a random scale, where it is larger than the canvas a random part of it."""
    scale = _scale(example, size * float(np.exp(generator.uniform(*np.log(SINGLE_SCALES)))), generator)
    width, height = example.image.shape[1::-1] * scale
    room = np.array([size - width, size - height])
    corner = np.where(room < 0, generator.uniform(0.0, 1.0, 2) * room, generator.uniform(0.0, 1.0, 2) ** 2 * room)
    return _composed(size, [(example, scale, corner, np.array([0.0, 0.0, size, size]))])


def plain(example: Example, size: int, stretched: bool = True) -> Example:
    """The picture as at inference: stretched to the square, or at the top left on grey."""
    sides = np.array(example.image.shape[1::-1], dtype=np.float64)
    scale = size / (sides if stretched else np.full(2, sides.max()))
    return _composed(size, [(example, scale, np.zeros(2), np.array([0.0, 0.0, size, size]))])


def flip(example: Example) -> Example:
    """Mirrors a picture and its boxes about the vertical axis."""
    boxes = example.boxes.copy()
    boxes[:, [0, 2]] = example.image.shape[1] - example.boxes[:, [2, 0]]
    return replace(example, image=np.ascontiguousarray(example.image[:, ::-1]), boxes=boxes)


def recolour(image: NDArray[np.uint8], generator: Generator) -> NDArray[np.uint8]:
    """Hue, saturation, value, gamma and contrast; sometimes grey, colour cast, blur, sensor noise."""
    hue, saturation, value = generator.uniform(-1, 1, 3) * (0.03, 0.5, 0.35) + (0, 1, 1)
    levels = np.arange(256, dtype=np.float32)
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    gamma = np.exp(generator.uniform(-0.4, 0.4))
    tables = (
        (levels + hue * 180) % 180,
        np.clip(levels * saturation, 0, 255),
        np.clip((levels / 255.0) ** gamma * 255.0 * value, 0, 255),
    )
    hsv = cv2.LUT(hsv, np.stack(tables, axis=-1).astype(np.uint8)[None])
    image = np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), dtype=np.uint8)
    if generator.random() < 0.05:
        image = np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    if generator.random() < 0.3:
        gains = generator.uniform(0.85, 1.15, 3)
        image = np.asarray(cv2.LUT(image, np.clip(levels[:, None] * gains, 0, 255).astype(np.uint8)[None]), np.uint8)
    if generator.random() < 0.15:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), generator.uniform(0.4, 1.6)), np.uint8)
    if generator.random() < 0.2:
        noise = generator.standard_normal(image.shape, dtype=np.float32) * generator.uniform(2.0, 10.0)
        image = np.clip(image + noise, 0.0, 255.0).astype(np.uint8)
    return image


def _scale(example: Example, longer: float, generator: Generator) -> NDArray[np.float64]:
    """Of x and y: the longer side gets that many px, the other one anything up to being as long."""
    sides = np.array(example.image.shape[1::-1], dtype=np.float64)
    return longer / sides.max() * (sides.max() / sides) ** generator.uniform(*STRETCH)


def _composed(size: int, placed: Sequence[tuple[Example, NDArray, NDArray, NDArray]]) -> Example:
    """A square grey canvas with pictures: each with its scale, its corner and the window (xyxy) that shows it."""
    canvas = np.full((size, size, 3), PAD, dtype=np.uint8)
    columns = zip(*(_paste(canvas, *one) for one in placed), strict=True)
    boxes, labels, visible, scores = map(np.concatenate, columns)
    return Example(canvas, boxes, labels, visible, scores=scores)


def _paste(canvas: NDArray, example: Example, scale: NDArray, corner: NDArray, window: NDArray) -> tuple[NDArray, ...]:
    """Draw a scaled picture at `corner` inside `window` (xyxy); boxes there, labels, visible shares, certainties."""
    left, top, right, bottom = (int(v) for v in np.rint(window))
    matrix = np.array([[scale[0], 0.0, corner[0]], [0.0, scale[1], corner[1]]])
    # From outer edges of pixels to their centres, which OpenCV counts in.
    matrix[:, 2] += (scale - 1.0) / 2.0
    x0, y0 = (int(max(low, np.floor(at))) for low, at in zip((left, top), corner, strict=True))
    far = corner + np.array(example.image.shape[1::-1]) * scale
    x1, y1 = (int(min(high, np.ceil(at))) for high, at in zip((right, bottom), far, strict=True))
    if x1 > x0 and y1 > y0:
        matrix[:, 2] -= (x0, y0)
        canvas[y0:y1, x0:x1] = cv2.warpAffine(
            example.image, matrix, (x1 - x0, y1 - y0), borderMode=cv2.BORDER_CONSTANT, borderValue=(PAD, PAD, PAD)
        )
    moved = example.boxes * np.tile(scale, 2) + np.tile(corner, 2)
    clipped = np.clip(moved, [left, top, left, top], [right, bottom, right, bottom])
    before, after = ((b[:, 2:] - b[:, :2]).prod(axis=1) for b in (moved, clipped))
    share = after / np.maximum(before, 1e-6)
    keep = after > 0.0
    return (
        clipped[keep].astype(np.float32),
        example.labels[keep],
        (example.visible * share)[keep].astype(np.float32),
        example.certainty()[keep],
    )
