"""Tables on four legs."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.materials.plain import metal
from edgemap.simulation.apartment.made.shapes.bars import beam, tube
from edgemap.simulation.apartment.made.shapes.lofts import lathe
from edgemap.simulation.apartment.made.shapes.solids import block
from edgemap.simulation.apartment.made.tables.table import Table
from edgemap.simulation.render.mesh import Array, Material, Mesh

_X = (1.0, 0.0, 0.0)


def legs(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Four legs: square or round, straight or tapered or turned, upright or splayed; apron, stretchers, drawer."""
    size = float(rng.uniform(0.035, 0.1))
    style = int(rng.integers(5))
    inset = size / 2.0 + float(rng.choice([0.0, 0.01, 0.04, 0.1]))
    spread = float(rng.uniform(0.02, 0.1)) if style in (1, 3) and rng.random() < 0.6 else 0.0
    taper = float(rng.uniform(0.45, 0.8)) if style in (1, 3) else 1.0
    corners, meshes = table.corners(inset + (spread * 0.7 if inset < 0.1 else 0.0)), []
    profile = _turned(rng, size / 2.0) if style == 4 else None
    for x, y in corners:
        foot = np.array([x + np.sign(x) * spread, y + np.sign(y) * spread, 0.0])
        head = np.array([x, y, table.under - 0.5 * size * spread])
        if profile is not None:
            up = np.linspace(0.0, 1.0, 26)
            post = Mesh((lathe(profile(up), up * table.under * 0.86, table.feet, 14),))
            meshes.append(post.placed(float(foot[0]), float(foot[1]), 0.0, 0.0))
            meshes.append(block(x, y, table.under * 0.85, size, size, table.under * 0.15, table.feet))
        elif style in (2, 3):
            meshes.append(tube(head, foot, size / 2.0, table.feet, size / 2.0 * taper))
        else:
            meshes.append(beam(head, foot, (size, size), table.feet, taper, _X, level=True))
    glass = table.top.opacity < 1.0
    if glass or rng.random() < 0.65:
        tall = float(rng.uniform(0.05, 0.12)) if not glass else float(rng.uniform(0.02, 0.05))
        meshes += _apron(corners, table.under - tall, tall, 0.022, table.feet)
        if rng.random() < 0.15 and not glass and not table.round_:
            meshes += _drawer(rng, corners, table, tall)
    if rng.random() < 0.22:
        z = float(rng.uniform(0.1, 0.22))
        out = corners + np.sign(corners) * spread * (1.0 - z / table.under)
        meshes += _stretchers(rng, out, z, min(0.04, size * 0.8), table.feet)
    return meshes


def _turned(rng: np.random.Generator, radius: float) -> PchipInterpolator:
    """A turned leg's radius by height: foot, ring, belly, neck, block."""
    knots = np.array([0.0, 0.06, 0.13, 0.2, float(rng.uniform(0.35, 0.6)), 0.78, 0.84, 0.9, 1.0])
    belly, neck = float(rng.uniform(0.7, 1.25)), float(rng.uniform(0.5, 0.75))
    factors = np.array([0.55, 0.85, 0.5, neck, belly, neck, 1.05, 0.7, 0.95])
    return PchipInterpolator(knots, factors * radius)


def _apron(corners: Array, low: float, tall: float, thick: float, material: Material) -> list[Mesh]:
    (x, y), _, _, _ = np.abs(corners)
    return [block(sign * x, 0.0, low, thick, 2.0 * y, tall, material) for sign in (-1.0, 1.0)] + [
        block(0.0, sign * y, low, 2.0 * x, thick, tall, material) for sign in (-1.0, 1.0)
    ]


def _drawer(rng: np.random.Generator, corners: Array, table: Table, tall: float) -> list[Mesh]:
    wide, x = float(rng.uniform(0.3, 0.45)), float(np.abs(corners[0, 0])) + 0.012
    front = block(x, 0.0, table.under - tall + 0.008, 0.012, wide, tall - 0.014, table.feet)
    return [front, tube((x, 0.0, table.under - tall / 2), (x + 0.028, 0.0, table.under - tall / 2), 0.013, metal(rng))]


def _stretchers(rng: np.random.Generator, corners: Array, z: float, size: float, material: Material) -> list[Mesh]:
    """Bars low between the legs: all round, or as an H."""
    (x, y), way = np.abs(corners[0]), rng.random()
    ends = [beam((-x, s * y, z), (x, s * y, z), (size, size), material) for s in (-1.0, 1.0)]
    if way < 0.5:
        return ends + [beam((0.0, -y, z), (0.0, y, z), (size, size), material, across=_X)]
    return ends + [beam((s * x, -y, z), (s * x, y, z), (size, size), material, across=_X) for s in (-1.0, 1.0)]
