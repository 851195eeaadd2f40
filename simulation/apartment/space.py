"""Free space while a home is furnished: boxes that must not collide, and paths that must stay free."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from edgemap.simulation.apartment.plan import ApartmentPlan, Rectangle
from edgemap.simulation.render.mesh import Array

_CELL_M = 0.05
# Radius of the robot, its margin, and what cells of this size may hide.
_ROBOT_M = 0.18 + 0.08 + 0.05
# What stands this high or lower is in the robot's way; the least floor of a room that it must be able to reach.
_PASS_M = 0.6
_REACH_M2, _REACH_SHARE = 0.5, 0.12


class Boxes:
    """Upright boxes: oriented rectangles (4, 2) counter-clockwise, from a low to a high z, each with a number."""

    def __init__(self) -> None:
        self._boxes: list[tuple[Array, float, float, int]] = []

    def add(self, corners: Array, low_m: float, high_m: float, number: int) -> None:
        """One more box."""
        self._boxes.append((corners, low_m, high_m, number))

    def meets(self, corners: Array, low_m: float, high_m: float, ignore: int = -1) -> bool:
        """Whether a box overlaps any of them, that of the number to ignore apart (separating axes)."""
        low_m, high_m = low_m + 1e-4, high_m - 1e-4
        near = [box for box, low, high, number in self._boxes if low < high_m and high > low_m and number != ignore]
        if not near:
            return False
        others = np.array(near)
        apart = np.zeros(len(others), dtype=bool)
        own = np.diff(corners[:3], axis=0)
        for axis in own:
            a, b = corners @ axis, others @ axis
            apart |= (b.max(axis=1) < a.min() + 1e-6) | (b.min(axis=1) > a.max() - 1e-6)
        for axes in (others[:, 1] - others[:, 0], others[:, 2] - others[:, 1]):
            a, b = axes @ corners.T, np.einsum("nij,nj->ni", others, axes)
            apart |= (b.max(axis=1) < a.min(axis=1) + 1e-6) | (b.min(axis=1) > a.max(axis=1) - 1e-6)
        return not bool(apart.all())


def rectangle_corners(rectangle: Rectangle) -> Array:
    """Corners (4, 2), counter-clockwise."""
    x0, y0, x1, y1 = rectangle
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


class Floor:
    """The floor on a grid; checks that the robot can still pass every doorway and enter every room."""

    def __init__(self, plan: ApartmentPlan) -> None:
        columns, rows = (int(np.ceil(side / _CELL_M)) for side in (plan.width_m, plan.depth_m))
        self._x, self._y = np.meshgrid((np.arange(columns) + 0.5) * _CELL_M, (np.arange(rows) + 0.5) * _CELL_M)
        self._free = np.zeros((rows, columns), dtype=bool)
        for hole in (*plan.rooms, *plan.doorways):
            self._free |= self._inside(hole.rectangle)
        for leaf in plan.leaves:
            self._free &= ~self._inside(leaf)
        middles = [((door.y0 + door.y1) / 2.0, (door.x0 + door.x1) / 2.0) for door in plan.doorways]
        self._doors = [(int(y / _CELL_M), int(x / _CELL_M)) for y, x in middles]
        self._rooms = [self._inside(room.rectangle) for room in plan.rooms]
        self._least = [
            max(_REACH_M2, _REACH_SHARE * (room.x1 - room.x0) * (room.y1 - room.y0)) / _CELL_M**2 for room in plan.rooms
        ]

    def takes(self, corners: Array, low_m: float) -> bool:
        """Occupies floor unless that would cut off a room. Returns whether it did."""
        if low_m >= _PASS_M:
            return True
        low, high = corners.min(axis=0) - _CELL_M, corners.max(axis=0) + _CELL_M
        columns = slice(max(int(low[0] / _CELL_M), 0), int(high[0] / _CELL_M) + 1)
        rows = slice(max(int(low[1] / _CELL_M), 0), int(high[1] / _CELL_M) + 1)
        points = np.stack([self._x[rows, columns], self._y[rows, columns]], axis=-1)
        covered = np.ones(points.shape[:2], dtype=bool)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            side = b - a
            covered &= side[0] * (points[..., 1] - a[1]) - side[1] * (points[..., 0] - a[0]) >= 0.0
        after = self._free.copy()
        after[rows, columns] &= ~covered
        if not self._connected(after):
            return False
        self._free = after
        return True

    def _connected(self, free: NDArray[np.bool_]) -> bool:
        wide = np.asarray(distance_transform_edt(free)) * _CELL_M > _ROBOT_M
        regions, count = cast(tuple[NDArray[np.int32], int], label(wide))
        if not count:
            return False
        main = regions[self._doors[0]] if self._doors else int(np.bincount(regions.ravel())[1:].argmax()) + 1
        if main == 0 or any(regions[door] != main for door in self._doors):
            return False
        return all(
            (room & (regions == main)).sum() >= least for room, least in zip(self._rooms, self._least, strict=True)
        )

    def _inside(self, rectangle: Rectangle) -> NDArray[np.bool_]:
        x0, y0, x1, y1 = rectangle
        return (self._x > x0) & (self._x < x1) & (self._y > y0) & (self._y < y1)
