"""What feet have to fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from edgemap.simulation.render.mesh import Array, Material, Mesh


@dataclass(frozen=True, slots=True)
class Table:
    """The top's size and its lower face's height, metres, and materials."""

    depth: float
    width: float
    under: float
    round_: bool
    top: Material
    feet: Material

    def corners(self, inset: float) -> Array:
        """Where four feet stand under the top (4, 2)."""
        half = np.array([self.depth, self.width]) / 2.0 * (0.62 if self.round_ else 1.0)
        return np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * (half - (0.0 if self.round_ else inset))


Feet = Callable[[np.random.Generator, Table], list[Mesh]]
