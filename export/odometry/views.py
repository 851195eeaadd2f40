"""Geometrically exact augmentation of a drive: a rotated, zoomed or mirrored camera is a homography of the picture."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.export.errors import ExportError
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.odometry.flow_cells import CellGrid

Array = NDArray[np.float64]


# Uniform ranges of random views. Degrees of the camera from its mount: yaw, pitch and roll, small enough that a car's
# road stays in view. Natural logarithms: of the focal length (zoom), and of brightness (gain and gamma).
ANGLES_DEG = ((-10.0, 10.0), (-2.5, 4.0), (-3.0, 3.0))
LOG_FACTORS = ((-0.15, 0.25), (-0.4, 0.4), (-0.25, 0.25))


@dataclass(frozen=True, slots=True)
class AugmentedView:
    """Transformation of a drive's pictures: they are mirrored, rotated (about the optical axes down, right and ahead),
    zoomed and changed in brightness, in this order.
    """

    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    zoom: float = 1.0
    gain: float = 1.0
    gamma: float = 1.0
    mirrored: bool = False

    @staticmethod
    def drawn(index: int) -> "AugmentedView":
        """The view of a number, from 1: the same in each call. Every second one is mirrored."""
        rng = np.random.default_rng((77, index))
        angles = [float(rng.uniform(math.radians(low), math.radians(high))) for low, high in ANGLES_DEG]
        factors = [math.exp(rng.uniform(*span)) for span in LOG_FACTORS]
        return AugmentedView(*angles, *factors, mirrored=index % 2 == 1)

    def rotation(self) -> Array:
        """Rotation matrix (3, 3) from the view's optical frame to the camera's."""
        yaw, pitch, roll = (
            cv2.Rodrigues(np.array(axis))[0]
            for axis in ([0.0, self.yaw_rad, 0.0], [self.pitch_rad, 0.0, 0.0], [0.0, 0.0, self.roll_rad])
        )
        return np.asarray(yaw @ pitch @ roll, dtype=np.float64)

    def camera(self, camera: FloorCamera) -> FloorCamera:
        """The view's camera before its rotation. Raises ExportError for a lens with distortion."""
        lens, mount = camera.intrinsics, camera.mount
        if lens.distortion.model != "none":
            raise ExportError("views of a lens that distorts are not homographies: undistort the pictures first")
        if self.mirrored:
            lens = replace(lens, cx=lens.width - 1.0 - lens.cx)
            mount = replace(mount, roll_rad=-mount.roll_rad, left_m=-mount.left_m)
        return FloorCamera(replace(lens, fx=lens.fx * self.zoom, fy=lens.fy * self.zoom), mount)

    def picture(self, picture: NDArray[np.uint8], lens: Intrinsics, grey: int) -> NDArray[np.uint8]:
        """The picture in this view, grey outside the camera's field of view."""
        levels = 255.0 * self.gain * np.linspace(0.0, 1.0, 256) ** self.gamma
        levels = np.rint(np.clip(levels, 0.0, 255.0)).astype(np.uint8)
        changed = np.asarray(levels[picture[:, ::-1] if self.mirrored else picture])
        size = lens.width, lens.height
        seen = cv2.warpPerspective(changed, self._homography(lens), size, borderValue=(grey,) * 3)
        return np.asarray(seen, dtype=np.uint8)

    def shows(self, grid: CellGrid, lens: Intrinsics) -> NDArray[np.bool_]:
        """Whether the centre of each cell lies in the camera's picture, bool (rows, columns)."""
        here = np.column_stack([grid.to_picture(grid.centres_px()), np.ones(grid.rows * grid.columns)])
        there = here @ np.linalg.inv(self._homography(lens)).T
        u, v = (there[:, :2] / there[:, 2:]).T
        inside = (u > -0.5) & (u < lens.width - 0.5) & (v > -0.5) & (v < lens.height - 0.5) & (there[:, 2] > 0.0)
        return np.asarray(inside.reshape(grid.rows, grid.columns))

    def _homography(self, lens: Intrinsics) -> Array:
        """Homography (3, 3) from the picture, mirrored where the view is mirrored, to the view's picture."""
        cx = lens.width - 1.0 - lens.cx if self.mirrored else lens.cx
        matrix = np.array([[lens.fx, 0.0, cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
        return matrix @ np.diag([self.zoom, self.zoom, 1.0]) @ self.rotation().T @ np.linalg.inv(matrix)
