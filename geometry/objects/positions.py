"""Points in the plane that change one by one, and which of them are near another point."""

from collections.abc import Hashable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array

Key = TypeVar("Key", bound=Hashable)


class Positions(Generic[Key]):
    """Keys with a position each."""

    def __init__(self) -> None:
        self._keys: list[Key] = []
        self._rows: dict[Key, int] = {}
        self._points_m = np.zeros((64, 2))  # of the keys, and spare rows

    def set(self, key: Key, position_m: Array) -> None:
        """Add a key at (2,), or move it there."""
        row = self._rows.setdefault(key, len(self._keys))
        if row == len(self._keys):
            self._keys.append(key)
        if row == len(self._points_m):
            self._points_m = np.concatenate([self._points_m, np.zeros_like(self._points_m)])
        self._points_m[row] = position_m

    def remove(self, key: Key) -> None:
        """Removes a key, if it is there; the last one moves to its row."""
        if (row := self._rows.pop(key, None)) is None:
            return
        if (last := self._keys.pop()) != key:
            self._keys[row], self._rows[last] = last, row
            self._points_m[row] = self._points_m[len(self._keys)]

    def within(self, points_m: ArrayLike, reach_m: float) -> list[Key]:
        """Keys within a distance of a point (2,), or of any of several (M, 2), in a deterministic order."""
        away_m2 = np.square(self._points_m[: len(self._keys)] - np.reshape(points_m, (-1, 1, 2))).sum(axis=-1)
        return [self._keys[row] for row in np.flatnonzero((away_m2 <= reach_m * reach_m).any(axis=0)).tolist()]
