"""A grid index of points in the plane: looks up nearby points in constant time."""

import math
from collections.abc import Hashable
from typing import Generic, TypeVar

from edgemap.geometry.arrays import Array

Key = TypeVar("Key", bound=Hashable)


class Cells(Generic[Key]):
    """Keys with a position each, in cells of a metre."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], dict[Key, None]] = {}
        self._places: dict[Key, tuple[float, float]] = {}

    def __len__(self) -> int:
        return len(self._places)

    def set(self, key: Key, position_m: Array) -> None:
        """Add a key at (2,), or move it there."""
        if key in self._places:
            self.remove(key)
        x_m, y_m = self._places[key] = position_m.tolist()
        self._cells.setdefault(_cell(x_m, y_m), {})[key] = None

    def remove(self, key: Key) -> None:
        """Removes an existing key."""
        cell = _cell(*self._places.pop(key))
        del self._cells[cell][key]
        if not self._cells[cell]:
            del self._cells[cell]

    def within(self, point_m: Array, reach_m: float) -> list[Key]:
        """Keys within a distance of a point (2,), in a deterministic order."""
        x_m, y_m = point_m.tolist()
        (i, j), ring, near = _cell(x_m, y_m), math.ceil(reach_m), list[Key]()
        for a in range(i - ring, i + ring + 1):
            for b in range(j - ring, j + ring + 1):
                for key in self._cells.get((a, b), ()):
                    at_x_m, at_y_m = self._places[key]
                    if (at_x_m - x_m) ** 2 + (at_y_m - y_m) ** 2 <= reach_m * reach_m:
                        near.append(key)
        return near


def _cell(x_m: float, y_m: float) -> tuple[int, int]:
    return math.floor(x_m), math.floor(y_m)
