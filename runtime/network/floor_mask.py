"""The backbone's floor output as a mask of the picture."""

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.runtime.network.manifest import FloorSpec
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import Placement

WHOLE = 1e-6  # cells; nearer to a whole number an edge of the picture is an edge of cells


def floor_mask(outputs: Tensors, placement: Placement, spec: FloorSpec | None) -> FloorMask | None:
    """The floor mask of the picture placed at `placement` in the input, without padding; None without a floor head.

    Where the picture ends within a cell, the mask is resampled so that its cells fill the picture exactly.
    """
    if spec is None:
        return None
    left, top = placement.left / spec.stride, placement.top / spec.stride
    columns, rows = placement.width / spec.stride, placement.height / spec.stride
    whole = all(abs(edge - round(edge)) < WHOLE for edge in (left, top, columns, rows))
    planes = [_cut(plane, left, top, columns, rows, whole) for plane in outputs[spec.name][0]]
    wall = planes[1] if len(planes) > 1 else None
    return FloorMask(planes[0], placement.image_width, placement.image_height, wall)


def _cut(
    plane: NDArray[np.float32], left: float, top: float, columns: float, rows: float, whole: bool
) -> NDArray[np.float32]:
    if whole:
        first_row, first_column = round(top), round(left)
        return plane[first_row : first_row + round(rows), first_column : first_column + round(columns)].copy()
    across, down = max(round(columns), 1), max(round(rows), 1)
    x = (left + (np.arange(across) + 0.5) * columns / across - 0.5).astype(np.float32)
    y = (top + (np.arange(down) + 0.5) * rows / down - 0.5).astype(np.float32)
    grid = np.meshgrid(x, y)
    return np.asarray(cv2.remap(plane, *grid, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
