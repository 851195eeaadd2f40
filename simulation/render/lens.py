"""A bent lens on top of OpenGL's pinhole: draw wider, then look every pixel up where the lens would have taken it."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Array

# The lens is worked out on a grid this wide and interpolated: exact to about a thousandth of a pixel.
_GRID_PX = 4
_WIDEST = 3.0
# cv2.remap's second map, which whole numbers make superfluous.
_NO_MAP: Any = None


class Lens:
    """A camera as a pinhole picture and the way from it to the bent one.

    pinhole: the camera to draw with. area_px: (H, W), how many pinhole pixels one bent pixel stands for.
    Raises SimulationError for a lens that folds the picture or needs more than three times its width or height.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.is_identity = intrinsics.distortion.is_identity
        self.pinhole = intrinsics
        self.area_px: NDArray[np.float32] | None = None
        self._nearest: dict[int, NDArray[np.int16]] = {}
        if not self.is_identity:
            self._bend()

    def colour(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The bent picture of a pinhole picture."""
        if self.is_identity:
            return picture
        column_row, fraction = self._at
        return np.asarray(cv2.remap(picture, column_row, fraction, cv2.INTER_CUBIC), dtype=np.uint8)

    def exact(self, values: NDArray[np.uint8] | NDArray[np.float32], oversampling: int) -> np.ndarray:
        """Nearest values for the bent picture out of an oversampled pinhole picture (rows * n, columns * n) whose
        every n-th row and column goes through pixel centres; for ids and depth."""
        if self.is_identity:
            return np.ascontiguousarray(values[::oversampling, ::oversampling])
        if oversampling not in self._nearest:
            at = np.round(self._where * oversampling)
            limit = np.array([self.pinhole.width, self.pinhole.height]) * oversampling - 1
            self._nearest[oversampling] = np.clip(at, 0, limit).astype(np.int16)
        return np.asarray(cv2.remap(values, self._nearest[oversampling], _NO_MAP, cv2.INTER_NEAREST))

    def _bend(self) -> None:
        intrinsics = self.intrinsics
        columns, rows = (np.arange(0, n + _GRID_PX, _GRID_PX) for n in (intrinsics.width, intrinsics.height))
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        ideal = intrinsics.rays(grid)[:, :2]
        again = intrinsics.project(np.column_stack([ideal, np.ones(len(ideal))]))
        inside = (grid <= [intrinsics.width, intrinsics.height]).all(axis=1)
        if np.abs(again - grid)[inside].max() > 0.1 or np.abs(ideal[inside]).max() > _WIDEST:
            raise SimulationError(f"lens distortion {list(intrinsics.distortion.coefficients)} folds the picture")
        focal, centre = np.array([intrinsics.fx, intrinsics.fy]), np.array([intrinsics.cx, intrinsics.cy])
        at = (ideal * focal + centre).reshape(len(rows), len(columns), 2)
        dense = _dense(at, intrinsics.height, intrinsics.width)
        low = np.floor(dense.reshape(-1, 2).min(axis=0)).astype(int) - 2
        high = np.ceil(dense.reshape(-1, 2).max(axis=0)).astype(int) + 3
        width, height = (int(n) for n in high - low)
        if width > _WIDEST * intrinsics.width or height > _WIDEST * intrinsics.height:
            raise SimulationError(f"lens distortion {list(intrinsics.distortion.coefficients)} is too strong to draw")
        self.pinhole = replace(
            intrinsics,
            width=width,
            height=height,
            cx=intrinsics.cx - float(low[0]),
            cy=intrinsics.cy - float(low[1]),
            distortion=Distortion(),
        )
        self._where = dense - low
        self._at = cv2.convertMaps(
            self._where[..., 0].astype(np.float32), self._where[..., 1].astype(np.float32), cv2.CV_16SC2
        )
        (du_dv, du_du), (dv_dv, dv_du) = (np.gradient(self._where[..., axis]) for axis in (0, 1))
        self.area_px = np.abs(du_du * dv_dv - du_dv * dv_du).astype(np.float32)


def _dense(coarse: Array, height: int, width: int) -> Array:
    """Values at every pixel from those at every `_GRID_PX`-th one."""
    rows, columns = np.mgrid[0:height, 0:width]
    row, column = rows // _GRID_PX, columns // _GRID_PX
    a = ((rows % _GRID_PX) / _GRID_PX)[..., None]
    b = ((columns % _GRID_PX) / _GRID_PX)[..., None]
    top = (1.0 - b) * coarse[row, column] + b * coarse[row, column + 1]
    bottom = (1.0 - b) * coarse[row + 1, column] + b * coarse[row + 1, column + 1]
    return (1.0 - a) * top + a * bottom
