"""Input of a learned odometry about lens and mount: the floor's geometry at each cell of its grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera

CHANNELS = 8


@dataclass(frozen=True, slots=True)
class CellGrid:
    """Cells of `stride_px` over a network's input, (rows, columns), and where the picture lies in that input.

    scale: input px per picture px, across and down. left_px, top_px: of the picture in the input.
    width_px, height_px: of the picture in the input.
    """

    rows: int
    columns: int
    stride_px: int
    scale: tuple[float, float]
    left_px: int
    top_px: int
    width_px: int
    height_px: int

    def centres_px(self) -> NDArray[np.float64]:
        """Middles of the cells in input px from the outer edge of the first one, (rows * columns, 2)."""
        v, u = np.mgrid[0 : self.rows, 0 : self.columns]
        return (np.column_stack([u.ravel(), v.ravel()]) + 0.5) * self.stride_px

    def to_picture(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Input px (from outer edges) to picture px (from the middle of the first one), (N, 2)."""
        return (points_px - [self.left_px, self.top_px]) / self.scale - 0.5

    def inside(self) -> NDArray[np.bool_]:
        """Which cells' middles lie in the picture and not in the letterbox's grey, (rows * columns,)."""
        u, v = self.centres_px().T
        across = (u >= self.left_px) & (u <= self.left_px + self.width_px)
        return across & (v >= self.top_px) & (v <= self.top_px + self.height_px)


def flow_cells(
    camera: FloorCamera, grid: CellGrid, rotated: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The geometry of a grid's cells, (1, 8, rows, columns), and of the mount, (1, 12), both float32.

    Channels: normalised image point x, y of the cell's middle, undistorted; its change per cell to the right (x, y) and
    down (x, y); inverse depth of the floor there along the optical axis, 1/m, 0 at or above the horizon; 1. All are 0
    where the cell does not show the picture. Mount: the rotation base
    from optical, row by row, then the lens in the base frame, metres. rotated: (3, 3), takes directions of a camera
    that is rotated against the mount into those of the mount's.
    """
    middles = grid.centres_px()
    half = 0.5 * grid.stride_px

    def bearings(offset: tuple[float, float]) -> NDArray[np.float64]:
        return camera.intrinsics.rays(grid.to_picture(middles + np.array(offset)))[:, :2]

    here = bearings((0.0, 0.0))
    right = bearings((half, 0.0)) - bearings((-half, 0.0))
    down = bearings((0.0, half)) - bearings((0.0, -half))
    rotation = camera.mount.rotation_base_optical() @ (np.eye(3) if rotated is None else rotated)
    falls = (np.column_stack([here, np.ones(len(here))]) @ rotation.T)[:, 2]
    floor = np.maximum(0.0, -falls) / camera.mount.height_m
    channels = np.column_stack([here, right, down, floor, np.ones(len(here))])
    shown = grid.inside() & np.isfinite(channels).all(axis=1)
    channels = np.where(shown[:, None], channels, 0.0)
    cells = channels.T.reshape(1, CHANNELS, grid.rows, grid.columns)
    mount = np.concatenate([rotation.ravel(), camera.mount.position_base_m()])[None]
    return np.ascontiguousarray(cells, dtype=np.float32), mount.astype(np.float32)
