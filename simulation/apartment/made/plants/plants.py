"""Plants in pots: for the floor, and small ones for tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edgemap.simulation.apartment.made.plants.leafy import cactus, fountain, fronds, orchid, stalks, succulent, swords
from edgemap.simulation.apartment.made.plants.leaves import Growth
from edgemap.simulation.apartment.made.plants.pots import pot
from edgemap.simulation.apartment.made.plants.woody import bamboo, bush, rosettes, tree
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Mesh


def potted_plant(rng: np.random.Generator) -> Mesh:
    """A plant for the floor, 0.4 to 1.7 m high."""
    growth, low, high = _FLOOR[int(rng.integers(len(_FLOOR)))]
    total = float(rng.uniform(low, high))
    share = float(rng.uniform(0.2, 0.34)) if total > 0.8 else float(rng.uniform(0.3, 0.45))
    return _potted(rng, growth, total, share, (0.1, 0.22))


def small_plant(rng: np.random.Generator) -> Mesh:
    """A plant for a table or a sill, 0.15 to 0.4 m high."""
    growth = _SMALL[int(rng.integers(len(_SMALL)))]
    return _potted(rng, growth, float(rng.uniform(0.17, 0.38)), float(rng.uniform(0.28, 0.5)), (0.035, 0.085))


def _potted(rng: np.random.Generator, growth: Growth, total: float, share: float, radii: tuple[float, float]) -> Mesh:
    """A pot of this share of the total height, and what grows in it."""
    height = total * share
    radius = float(np.clip(height * rng.uniform(0.45, 0.75), *radii))
    meshes, soil = pot(rng, radius, height)
    parts = growth(rng, total - soil, radius * 0.75, soil)
    reach = max(float(np.abs(part.positions[..., :2]).max()) for part in parts)
    # What spreads wider than rooms have place for stays smaller as a whole.
    scale = min(1.0, max(min(0.65 * total, 0.75), 1.2 * radius) / reach)
    foot = np.array([0.0, 0.0, soil])
    parts = [replace(part, positions=foot + (part.positions - foot) * scale) for part in parts]
    return joined([*meshes, Mesh(tuple(parts))])


# What grows on the floor, and how high with its pot, metres.
_FLOOR: tuple[tuple[Growth, float, float], ...] = (
    (tree, 0.8, 1.7), (tree, 0.8, 1.7), (stalks, 0.5, 1.3), (stalks, 0.4, 1.1), (swords, 0.45, 1.1),
    (rosettes, 0.7, 1.7), (fronds, 0.7, 1.7), (fountain, 0.4, 0.8), (cactus, 0.5, 1.3), (bush, 0.45, 1.2),
    (bamboo, 0.7, 1.6), (orchid, 0.5, 0.8),
)  # fmt: skip
_SMALL: tuple[Growth, ...] = (
    cactus, succulent, succulent, orchid, swords, fountain, bush, stalks, bamboo, tree, fronds,
)  # fmt: skip
