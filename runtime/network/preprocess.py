"""A picture becomes the network's input tensor; boxes and the floor mask find their way back."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.runtime.network.manifest import FloorSpec, InputSpec
from edgemap.runtime.network.network import Tensors


@dataclass(frozen=True, slots=True)
class Placement:
    """Placement of the picture inside the input tensor: size and offset in input px, and the size of the picture."""

    width: int
    height: int
    left: int
    top: int
    image_width: int
    image_height: int

    def to_image(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Boxes (N, 4) xyxy from input px to picture px, clipped to the picture.

        Both count px from the outer edge of the first one, as Darknet and YOLOX do.
        """
        scale = np.array([self.image_width / self.width, self.image_height / self.height] * 2)
        moved = (boxes - np.array([self.left, self.top] * 2)) * scale
        limit = np.array([self.image_width, self.image_height] * 2, dtype=np.float64)
        return np.clip(moved, 0.0, limit)


def place(spec: InputSpec, image_width: int, image_height: int) -> Placement:
    """Placement of a picture of this size in the input under its resize rule (sizes cut to whole px, as in Darknet)."""
    if spec.resize == "stretch":
        return Placement(spec.width, spec.height, 0, 0, image_width, image_height)
    scale = min(spec.width / image_width, spec.height / image_height)
    width = max(1, min(spec.width, int(image_width * scale + 1e-9)))
    height = max(1, min(spec.height, int(image_height * scale + 1e-9)))
    left, top = (spec.width - width) // 2, (spec.height - height) // 2
    if spec.resize == "letterbox_topleft":
        left = top = 0
    return Placement(width, height, left, top, image_width, image_height)


EDGE_PX = 8  # of padding beside the picture that its features of stride 4 see, rather than the zeros beyond an input


def rows_of(spec: InputSpec, image_width: int, image_height: int, stride: int) -> tuple[int, int]:
    """The first row of the input that a picture of this size reaches and how many, in whole cells of a stride: the rest
    is padding, except for a margin that affects the features of the picture's edge. For a centred letterbox the same
    number is cut above and below, so that the picture stays centred.
    """
    if spec.resize == "stretch":
        return 0, spec.height
    where = place(spec, image_width, image_height)
    height = math.ceil(image_height * min(spec.width / image_width, spec.height / image_height) - 1e-9)  # not cut
    below = max(spec.height - where.top - height - EDGE_PX, 0) // stride * stride
    if spec.resize == "letterbox_topleft":
        return 0, spec.height - below
    above = min(max(where.top - EDGE_PX, 0) // stride * stride, below)
    return above, spec.height - 2 * above


class Preprocessor:
    """Fills one reused input tensor, (1, 3, H, W) float32, from BGR uint8 pictures."""

    def __init__(self, spec: InputSpec) -> None:
        self.spec = spec
        self._placement: Placement | None = None
        std = np.array(spec.std, dtype=np.float32)
        self._factor = (np.float32(spec.scale) / std)[:, None, None]
        self._offset = (np.array(spec.mean, dtype=np.float32) / std)[:, None, None]
        self._tensor = np.zeros((1, 3, spec.height, spec.width), dtype=np.float32)

    def __call__(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], Placement]:
        """The tensor, valid until the next call, and the placement that leads boxes back."""
        where = place(self.spec, image.shape[1], image.shape[0])
        if where != self._placement:
            self._placement, self._tensor[0] = where, self.spec.pad * self._factor - self._offset
        region = self._tensor[0, :, where.top : where.top + where.height, where.left : where.left + where.width]
        planes = cv2.split(cv2.resize(image, (where.width, where.height), interpolation=cv2.INTER_LINEAR))
        for channel, plane in enumerate(planes[::-1] if self.spec.colour == "rgb" else planes):
            region[channel] = plane
        if np.any(self._factor != 1.0):
            region *= self._factor
        if np.any(self._offset != 0.0):
            region -= self._offset
        return self._tensor, where


def floor_mask(outputs: Tensors, placement: Placement, spec: FloorSpec | None) -> FloorMask | None:
    """The floor mask of the picture placed at `placement` in the input, without padding; None without a floor head.

    Where the picture ends within a cell, the mask is resampled so that its cells fill the picture exactly.
    """
    if spec is None:
        return None
    floor, *wall = (_cut(plane, placement, spec.stride) for plane in outputs[spec.name][0])
    return FloorMask(floor, placement.image_width, placement.image_height, wall[0] if wall else None)


def _cut(plane: NDArray[np.float32], where: Placement, stride: int) -> NDArray[np.float32]:
    left, top, columns, rows = (side / stride for side in (where.left, where.top, where.width, where.height))
    across, down = max(round(columns), 1), max(round(rows), 1)
    if all(edge.is_integer() for edge in (left, top, columns, rows)):
        return plane[int(top) : int(top) + down, int(left) : int(left) + across].copy()
    x = (left + (np.arange(across) + 0.5) * columns / across - 0.5).astype(np.float32)
    y = (top + (np.arange(down) + 0.5) * rows / down - 0.5).astype(np.float32)
    grid = np.meshgrid(x, y)
    return np.asarray(cv2.remap(plane, *grid, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
