"""A room of upright boxes as a camera's floor mask has it: rays against boxes, nothing of the grid's own code."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2

LENS = Intrinsics(320, 240, 280.0, 280.0, 159.5, 119.5)
CAMERA = FloorCamera(LENS, Mount.from_degrees(0.5, 20.0, 0.0, 0.1))
ROWS, COLUMNS = 78, 104

Box = tuple[float, float, float, float, float]  # x0, y0, x1, y1 in the map, height: metres


def walls(x0: float, y0: float, x1: float, y1: float, thick_m: float = 0.2, high_m: float = 2.5) -> list[Box]:
    """Four walls round a rectangle of floor."""
    return [
        (x0 - thick_m, y0 - thick_m, x1 + thick_m, y0, high_m),
        (x0 - thick_m, y1, x1 + thick_m, y1 + thick_m, high_m),
        (x0 - thick_m, y0, x0, y1, high_m),
        (x1, y0, x1 + thick_m, y1, high_m),
    ]


def floor_mask(boxes: Sequence[Box], pose: SE2, camera: FloorCamera = CAMERA) -> FloorMask:
    """What a perfect head sees of these boxes: 1 where a ray meets the floor before any box, else 0."""
    lens = camera.intrinsics
    u = (np.arange(COLUMNS) + 0.5) * lens.width / COLUMNS - 0.5
    v = (np.arange(ROWS) + 0.5) * lens.height / ROWS - 0.5
    to_floor, to_box = _along_rays(boxes, pose, camera, u, v)
    floor = (np.isfinite(to_floor) & (to_floor <= to_box + 1e-9)).astype(np.float32)
    return FloorMask(floor.reshape(ROWS, COLUMNS), lens.width, lens.height)


def depth_picture(boxes: Sequence[Box], pose: SE2, camera: FloorCamera = CAMERA) -> NDArray[np.float32]:
    """The depth of floor and boxes along the optical axis, metres, (H, W); 0 where a ray meets neither."""
    lens = camera.intrinsics
    nearest = np.minimum(*_along_rays(boxes, pose, camera, np.arange(lens.width), np.arange(lens.height)))
    depth = np.where(np.isfinite(nearest), nearest, 0.0)  # rays have z = 1 along the optical axis
    return depth.reshape(lens.height, lens.width).astype(np.float32)


def _along_rays(
    boxes: Sequence[Box], pose: SE2, camera: FloorCamera, u: ArrayLike, v: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far along each ray of a lattice of pixels the floor is, and the nearest box; infinite where there is none."""
    rays = camera.rays_base(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2).astype(np.float64))
    origin = np.array([*pose.apply(camera.mount.position_base_m()[:2]), camera.mount.height_m])
    rays = np.column_stack([rays[:, :2] @ pose.rotation().T, rays[:, 2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        to_floor = np.where(rays[:, 2] < 0.0, -origin[2] / rays[:, 2], np.inf)
        to_box = np.full(len(rays), np.inf)
        for x0, y0, x1, y1, high_m in boxes:
            a, b = (np.array([x0, y0, 0.0]) - origin) / rays, (np.array([x1, y1, high_m]) - origin) / rays
            near, far = np.nanmax(np.minimum(a, b), axis=1), np.nanmin(np.maximum(a, b), axis=1)
            hit = (near <= far) & (near > 0.0)
            to_box[hit] = np.minimum(to_box[hit], near[hit])
    return to_floor, to_box


def area_m2(grid, value):
    """Total area of a grid's cells in one state, m^2."""
    return float((grid.cells == value).sum()) * grid.cell_m**2
