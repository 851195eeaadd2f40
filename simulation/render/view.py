"""Pose of the simulated camera, and OpenGL's projection for exactly edgemap's camera model.

A lens with distortion draws a wider pinhole picture, then takes every pixel from where the lens would have it.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Array

NEAR_M, FAR_M = 0.05, 40.0
TIMES = 2  # rows and columns drawn for each of the picture


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Pose of the camera in the room: rotation (3, 3) from optical to room axes, position (3,) in metres."""

    rotation_home_optical: Array
    position_home_m: Array

    @classmethod
    def of_base(cls, pose_home_base: SE2, mount: Mount, lean: Array | None = None, rise_m: float = 0.0) -> "View":
        """The view of a camera mounted on a base that stands in the room. lean: (3, 3), from the tilted base's axes to
        the level one's; rise_m: of the base above the floor."""
        turn = np.eye(3)
        turn[:2, :2] = pose_home_base.rotation()
        turn = turn if lean is None else turn @ lean
        position = turn @ mount.position_base_m() + [pose_home_base.x_m, pose_home_base.y_m, rise_m]
        return cls(turn @ mount.rotation_base_optical(), position)

    def to_optical(self, points_home_m: Array) -> Array:
        """Points of the room (N, 3) in the optical frame."""
        return (points_home_m - self.position_home_m) @ self.rotation_home_optical


def metres(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Optical depth from a depth buffer's 0..1, as `clip_matrix` fills it; FAR_M where nothing was drawn."""
    return np.float32(2.0 * FAR_M * NEAR_M) / (
        np.float32(FAR_M + NEAR_M) - (np.float32(2.0) * depth - np.float32(1.0)) * np.float32(FAR_M - NEAR_M)
    )


def oversampled(pinhole: Intrinsics) -> Intrinsics:
    """A pinhole with TIMES as many columns and rows whose pixel (n u, n v) looks where (u, v) looked."""
    names = ("width", "height", "fx", "fy", "cx", "cy")
    return replace(pinhole, **{name: TIMES * getattr(pinhole, name) for name in names})


def clip_matrix(view: View, intrinsics: Intrinsics) -> Array:
    """(4, 4) from homogeneous points of the home to OpenGL's clip space; pixel centres are integers.

    Column u becomes 2 (u + 1/2) / width - 1, row v becomes 2 (v + 1/2) / height - 1; w is the optical depth. OpenGL's
    lowest row is thus the picture's top row, and pixels that are read back need no flip.
    """
    width, height = intrinsics.width, intrinsics.height
    projection, optical_home = np.zeros((4, 4)), np.eye(4)
    projection[0, [0, 2]] = 2.0 * intrinsics.fx / width, 2.0 * (intrinsics.cx + 0.5) / width - 1.0
    projection[1, [1, 2]] = 2.0 * intrinsics.fy / height, 2.0 * (intrinsics.cy + 0.5) / height - 1.0
    projection[2, 2:] = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    projection[3, 2] = 1.0
    optical_home[:3, :3] = view.rotation_home_optical.T
    optical_home[:3, 3] = -view.rotation_home_optical.T @ view.position_home_m
    return projection @ optical_home


# The lens is worked out on a grid this wide and interpolated: exact to about a thousandth of a pixel.
_GRID_PX = 4
# cv2.remap's second map, which a first one of both coordinates makes superfluous.
NO_MAP: Any = None


class Lens:
    """A camera as a pinhole picture and the way from it to the bent one.

    pinhole: the camera to draw with. area_px: (H, W), how many pinhole pixels one bent pixel stands for. Lenses that
    fold the picture, or bend it more than a wide pinhole holds, are none of the envelope's.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.is_identity = intrinsics.distortion.is_identity
        self.pinhole = intrinsics
        self.area_px: NDArray[np.float32] | None = None
        if self.is_identity:
            return
        columns, rows = (np.arange(0, n + _GRID_PX, _GRID_PX) for n in (intrinsics.width, intrinsics.height))
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        ideal = intrinsics.rays(grid)[:, :2]
        focal, centre = np.array([intrinsics.fx, intrinsics.fy]), np.array([intrinsics.cx, intrinsics.cy])
        at = (ideal * focal + centre).reshape(len(rows), len(columns), 2)
        dense = _dense(at, intrinsics.height, intrinsics.width)
        low = np.floor(dense.reshape(-1, 2).min(axis=0)).astype(int) - 2
        width, height = (np.ceil(dense.reshape(-1, 2).max(axis=0)).astype(int) + 3 - low).tolist()
        cx, cy = (centre - low).tolist()
        self.pinhole = Intrinsics(width, height, intrinsics.fx, intrinsics.fy, cx, cy)
        where = dense - low
        self._at = cv2.convertMaps(where[..., 0].astype(np.float32), where[..., 1].astype(np.float32), cv2.CV_16SC2)
        limit = np.array([width, height]) * TIMES - 1
        self._nearest = np.clip(np.round(where * TIMES), 0, limit).astype(np.int16)
        (du_dv, du_du), (dv_dv, dv_du) = (np.gradient(where[..., axis]) for axis in (0, 1))
        self.area_px = np.abs(du_du * dv_dv - du_dv * dv_du).astype(np.float32)

    def colour(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The bent picture of a pinhole picture."""
        if self.is_identity:
            return picture
        column_row, fraction = self._at
        return np.asarray(cv2.remap(picture, column_row, fraction, cv2.INTER_CUBIC), dtype=np.uint8)

    def exact(self, values: NDArray[np.uint8] | NDArray[np.float32]) -> np.ndarray:
        """Nearest values for the bent picture out of the oversampled pinhole picture, whose every TIMES-th row and
        column goes through pixel centres; for ids and depth."""
        if self.is_identity:
            return np.ascontiguousarray(values[::TIMES, ::TIMES])
        return np.asarray(cv2.remap(values, self._nearest, NO_MAP, cv2.INTER_NEAREST))


def _dense(coarse: Array, height: int, width: int) -> Array:
    """Values at every pixel from those at every `_GRID_PX`-th one."""
    rows, columns = np.mgrid[0:height, 0:width]
    row, column = rows // _GRID_PX, columns // _GRID_PX
    a = ((rows % _GRID_PX) / _GRID_PX)[..., None]
    b = ((columns % _GRID_PX) / _GRID_PX)[..., None]
    top = (1.0 - b) * coarse[row, column] + b * coarse[row, column + 1]
    bottom = (1.0 - b) * coarse[row + 1, column] + b * coarse[row + 1, column + 1]
    return (1.0 - a) * top + a * bottom
