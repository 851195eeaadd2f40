"""Labelled pictures as a floor head learns from them: cut, flipped, relit, and with floors of other colours.

Labels are shares (H, W, 3) uint8 of other, floor and wall in 255ths; their sum is the label's weight.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.inputs.drives.pictures import decoded, read_picture
from edgemap.runtime.inputs.drives.truth import FloorLabel, read_floor_labels
from edgemap.runtime.network.preprocess import Placement

Image = NDArray[np.uint8]
Pair = tuple[Path, Path]  # a picture and its labels
Float = NDArray[np.float32]
SMALLEST = 0.3  # side of a crop, of the picture's: small enough that the lowest rows often show no floor
ASPECT = (0.8, 1.25)
CLASSES = (FloorLabel.OTHER, FloorLabel.FLOOR, FloorLabel.WALL)  # of the channels of the shares
SURE = 0.6  # share of a label where one must be named; below it a pixel is unknown
KEPT_PX = 512  # longer side of a picture in training
WHOLE = 0.15  # share of pictures that are not cut
TINTED, SUNLIT, RUGGED, WET, LITTERED = 0.5, 0.2, 0.2, 0.15, 0.2  # shares of those whose floor is changed so


def load(pair: Pair) -> tuple[Image, Image]:
    """A picture and its shares, at most KEPT_PX long. Raises CameraError."""
    image = read_picture(pair[0])
    height, width = image.shape[:2]
    shares = read_shares(pair[1], (width, height))
    scale = KEPT_PX / max(width, height)
    if scale >= 1.0:
        return image, shares
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return small, np.asarray(cv2.resize(shares, size, interpolation=cv2.INTER_NEAREST), np.uint8)


def read_shares(path: Path, size: tuple[int, int]) -> Image:
    """Shares of a picture of that size, (width, height), from a file of three channels, any size, or of floor labels.

    Raises CameraError where it is neither.
    """
    data = decoded(read_bytes(path, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if data is not None and data.dtype == np.uint8 and data.ndim == 3 and data.shape[2] == len(CLASSES):
        return np.asarray(cv2.resize(data, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    labels = read_floor_labels(path, size)
    return np.where(labels[..., None] == CLASSES, 255, 0).astype(np.uint8)


def named(shares: Image) -> Image:
    """Floor labels (H, W) of the largest shares; unknown where none reaches SURE."""
    labels = np.array(CLASSES, np.uint8)[shares.argmax(axis=2)]
    labels[shares.max(axis=2) < 255 * SURE] = FloorLabel.UNKNOWN
    return labels


def varied(image: Image, shares: Image, rng: np.random.Generator) -> tuple[Image, Image]:
    """A random augmentation of a picture: a crop, possibly mirrored, in other light, possibly with another floor."""
    if rng.random() > WHOLE:
        image, shares = _cut(image, shares, rng)
    if rng.random() < 0.5:
        image, shares = image[:, ::-1], shares[:, ::-1]
    light, shares = image.astype(np.float32), shares.copy()
    floor = (named(shares) == FloorLabel.FLOOR).astype(np.float32)
    for share, change in ((TINTED, _tinted), (RUGGED, _rugged), (WET, _wet), (SUNLIT, _sunlit)):
        if rng.random() < share:
            light = change(light, floor, rng)
    if rng.random() < LITTERED:
        _litter(light, shares, floor, rng)
    gain = np.exp(rng.normal(0.0, 0.25) + rng.normal(0.0, 0.06, 3)).astype(np.float32)
    light = light * gain + np.float32(rng.normal(0.0, 10.0))
    if rng.random() < 0.3:
        sigma = rng.uniform(0.4, 1.6)
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), sigma), np.float32)
    if rng.random() < 0.3:
        light = light + rng.normal(0.0, rng.uniform(2.0, 10.0), light.shape).astype(np.float32)
    return np.clip(light, 0, 255).astype(np.uint8), np.ascontiguousarray(shares)


def targets(shares: Image, placement: Placement, stride: int, shape: tuple[int, int]) -> tuple[Float, Float]:
    """The head's targets for a picture placed in the input: shares of floor and wall (2, rows, columns) in each cell's
    labelled part, and that part's share of the cell (rows, columns), 0 in the padding.
    """
    planes = shares.astype(np.float32) / 255.0
    planes[..., 0] = planes.sum(axis=2)  # what is labelled
    placed = np.zeros((shape[0] * stride, shape[1] * stride, 3), dtype=np.float32)
    small = cv2.resize(planes, (placement.width, placement.height), interpolation=cv2.INTER_AREA)
    top, left = placement.top, placement.left
    placed[top : top + placement.height, left : left + placement.width] = small
    cells = cv2.resize(placed, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    share = np.minimum(cells[..., 0], 1.0)
    parts = np.moveaxis(cells[..., 1:] / np.maximum(share, 1e-6)[..., None], 2, 0)
    return np.asarray(np.minimum(parts, 1.0), np.float32), np.asarray(share, np.float32)


def _cut(image: Image, shares: Image, rng: np.random.Generator) -> tuple[Image, Image]:
    height, width = shares.shape[:2]
    side, aspect = rng.uniform(SMALLEST, 1.0), np.sqrt(rng.uniform(*ASPECT))
    wide = max(8, round(min(1.0, side * aspect) * width))
    high = max(8, round(min(1.0, side / aspect) * height))
    left, top = rng.integers(0, width - wide + 1), rng.integers(0, height - high + 1)
    window = np.s_[top : top + high, left : left + wide]
    return image[window], shares[window]


def _tinted(light: Float, floor: Float, rng: np.random.Generator) -> Float:
    """The floor dyed: its lightness and pattern stay, its colour is another."""
    colour = rng.uniform(0.25, 1.3, 3).astype(np.float32)
    grey = light.mean(axis=2, keepdims=True)
    keep = np.float32(rng.uniform(0.0, 0.7))
    dyed = (keep * light + (1.0 - keep) * grey) * colour
    return np.asarray(light + floor[..., None] * (dyed - light), np.float32)


def _sunlit(light: Float, floor: Float, rng: np.random.Generator) -> Float:
    """A bright patch with straight sides on the floor, as from a window; or a dark one, a shadow."""
    patch = np.asarray(cv2.GaussianBlur(_patch(floor, rng), (0, 0), rng.uniform(0.5, 3.0)), np.float32)
    factor = np.float32(rng.uniform(1.3, 2.2) if rng.random() < 0.6 else rng.uniform(0.45, 0.8))
    return np.asarray(light * (1.0 + (patch * floor)[..., None] * (factor - 1.0)), np.float32)


def _rugged(light: Float, floor: Float, rng: np.random.Generator) -> Float:
    """A rug of two colours on the floor, striped, chequered or blotched, in the floor's own light."""
    height, width = floor.shape
    coarse = rng.random((int(rng.integers(2, 12)), int(rng.integers(1, 12)))).astype(np.float32)
    pattern = cv2.resize(coarse, (width, height), interpolation=int(rng.choice([cv2.INTER_NEAREST, cv2.INTER_CUBIC])))
    colours = rng.uniform(20.0, 230.0, (2, 3)).astype(np.float32)
    rug = colours[0] + np.clip(pattern, 0.0, 1.0)[..., None] * (colours[1] - colours[0])
    brightness = light.mean(axis=2, keepdims=True)
    shade = brightness / max(float(brightness[floor > 0.0].mean()), 1.0) if floor.any() else brightness
    share = (_patch(floor, rng) * floor)[..., None]
    return np.asarray(light + share * (rug * np.clip(shade, 0.3, 2.0) - light), np.float32)


def _wet(light: Float, floor: Float, rng: np.random.Generator) -> Float:
    """A floor that mirrors what stands above a row of the picture."""
    height = len(floor)
    rows = 2 * round(height * rng.uniform(0.3, 0.7)) - np.arange(height)
    mirrored = cv2.GaussianBlur(light[np.clip(rows, 0, height - 1)], (0, 0), rng.uniform(1.0, 6.0))
    share = (rng.uniform(0.1, 0.4) * floor)[..., None].astype(np.float32)
    return np.asarray(light + share * (mirrored - light), np.float32)


def _litter(light: Float, shares: Image, floor: Float, rng: np.random.Generator) -> None:
    """A few small objects on the floor, of other parts of the picture, in place: no floor."""
    rows, columns = np.nonzero(floor)
    height, width = floor.shape
    for at in rng.integers(0, len(rows), rng.integers(1, 4)) if len(rows) else ():
        wide, high = (max(4, round(side * rng.uniform(0.02, 0.14))) for side in (width, height))
        top, left = max(int(rows[at]) - high, 0), max(min(int(columns[at]) - wide // 2, width - wide), 0)
        window = np.s_[top : top + high, left : left + wide]
        y, x = int(rng.integers(0, height - high + 1)), int(rng.integers(0, width - wide + 1))
        texture = light[y : y + high, x : x + wide] * rng.uniform(0.5, 1.4, 3).astype(np.float32)
        shape = np.zeros((high, wide), np.uint8)
        corners = rng.uniform(0.0, 1.0, (int(rng.integers(4, 9)), 2)) * [wide, high]
        cv2.fillPoly(shape, [cv2.convexHull(np.round(corners).astype(np.int32))], (1,))
        shape = shape[: shares[window].shape[0]]
        light[window][shape > 0] = texture[: len(shape)][shape > 0]
        shares[window][shape > 0] = 255, 0, 0


def _patch(floor: Float, rng: np.random.Generator) -> Float:
    """A part of the picture with four straight sides, 1 inside."""
    height, width = floor.shape
    middle = rng.uniform([0.0, 0.4], [1.0, 1.0]) * [width, height]
    around = np.array([[-1.0, -0.4], [1.0, -0.6], [1.2, 0.5], [-0.8, 0.6]])
    corners = middle + rng.uniform(0.05, 0.35, (4, 1)) * width * around
    patch = np.zeros((height, width), np.float32)
    cv2.fillPoly(patch, [np.round(corners).astype(np.int32)], (1.0,))
    return patch
