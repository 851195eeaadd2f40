"""All light maps in one texture, so that a change of light is one upload."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import LightMix, LitSurface

_WIDTH = 1024


class Atlas:
    """Light maps side by side. places: per surface (u0, v0, u1, v1), the map's own border in the texture, 0..1."""

    def __init__(self, surfaces: Sequence[LitSurface]) -> None:
        at = _shelves([lit.lamp.shape[:2] for lit in surfaces])
        rows = max([16, *(row + lit.lamp.shape[0] + 2 for (row, _), lit in zip(at, surfaces, strict=True))])
        self.size = (_WIDTH, 1 << (rows - 1).bit_length())
        self._day, self._lamp = (np.zeros((self.size[1], _WIDTH, 3), dtype=np.float32) for _ in range(2))
        self.places: list[Array] = []
        for (row, column), lit in zip(at, surfaces, strict=True):
            height, width = lit.lamp.shape[:2]
            for sheet, light in ((self._day, lit.day), (self._lamp, lit.lamp)):
                # One more texel all around, for the filter.
                sheet[row : row + height + 2, column : column + width + 2] = np.pad(
                    light, ((1, 1), (1, 1), (0, 0)), "edge"
                )
            low = np.array([column + 1, row + 1], dtype=np.float64)
            self.places.append(np.concatenate([low, low + [width, height]]) / [*self.size, *self.size])

    def mixed(self, light: LightMix) -> NDArray[np.float16]:
        """The texture, (rows, columns, 4)."""
        sheet = np.ones((self.size[1], _WIDTH, 4), dtype=np.float16)
        sheet[..., :3] = light.day * self._day + light.lamp * self._lamp
        return sheet


def _shelves(shapes: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Row and column of each map (with its border), tallest first, shelf on shelf. Maps wider than the atlas cannot be
    placed; `light.py` keeps them smaller."""
    at: list[tuple[int, int]] = [(0, 0)] * len(shapes)
    row = column = shelf = 0
    for number in sorted(range(len(shapes)), key=lambda n: -shapes[n][0]):
        height, width = shapes[number][0] + 2, shapes[number][1] + 2
        if column + width > _WIDTH:
            row, column, shelf = row + shelf, 0, 0
        at[number] = row, column
        column, shelf = column + width, max(shelf, height)
    return at
