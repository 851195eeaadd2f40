"""Rests for arms of chairs."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.seats.backs import Back
from edgemap.simulation.apartment.made.seats.seat import Seat
from edgemap.simulation.apartment.made.shapes.bars import bar, rod
from edgemap.simulation.apartment.made.shapes.outlines import filleted
from edgemap.simulation.render.mesh import Material, Mesh


def arms(rng: np.random.Generator, seat: Seat, back: Back, radius: float, material: Material) -> list[Mesh]:
    """Rests from the back to props in front."""
    rest = seat.top + float(rng.uniform(0.19, 0.26))
    up = (rest - back.low) / (back.high - back.low)
    meshes, reach = [], seat.depth * float(rng.uniform(0.15, 0.42))
    for side in (1.0, -1.0):
        foot = np.array([reach, side * (seat.front / 2.0 - radius), seat.under])
        top = np.array([reach, side * (seat.front / 2.0 + 0.02), rest])
        path = np.array([back.at(side, up), (back.at(side, up) + top) / 2.0 + [0.0, 0.025 * side, 0.012], top])
        path = np.concatenate([path, [top + [0.05, 0.0, -0.008]]])
        meshes += [rod(filleted(path, 0.12), 0.024, material, 0.5), bar(foot, top, radius * 0.8, material, 0.03)]
    return meshes
