"""Chairs to sit at a table on."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.seats.joinery import bentwood, joiners, windsor
from edgemap.simulation.apartment.made.seats.modern import folding, garden, moulded, parsons, steel
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Mesh


def chair(rng: np.random.Generator) -> Mesh:
    """A chair to sit at a table on, in one of eight builds."""
    builds = (
        joiners,
        joiners,
        joiners,
        windsor,
        bentwood,
        parsons,
        moulded,
        moulded,
        steel,
        folding,
        garden,
    )
    return joined(builds[int(rng.integers(len(builds)))](rng))
