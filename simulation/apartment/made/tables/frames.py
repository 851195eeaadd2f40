"""Trestles, slabs, crosses and frames of metal that tables stand on."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import metal
from edgemap.simulation.apartment.made.shapes.bars import beam, rod, tube
from edgemap.simulation.apartment.made.shapes.solids import block
from edgemap.simulation.apartment.made.tables.table import Table
from edgemap.simulation.render.mesh import Mesh

_X = (1.0, 0.0, 0.0)


def trestles(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Two sawhorses: slanted legs, a bar on top, cross bars."""
    at = table.width / 2.0 - float(rng.uniform(0.15, 0.35))
    reach, size = table.depth / 2.0 - 0.06, float(rng.uniform(0.03, 0.06))
    lean, meshes = float(rng.uniform(0.04, 0.14)), []
    narrow = float(rng.uniform(0.15, 0.8))
    for side in (-1.0, 1.0):
        y = side * at
        bar = table.under - size
        meshes.append(block(0.0, y, bar, 2.0 * reach, size, size, table.feet))
        for end in (-1.0, 1.0):
            for way in (-1.0, 1.0):
                foot = (end * reach * 0.95, y + way * lean, 0.0)
                meshes.append(
                    beam(
                        (end * reach * narrow, y, bar + 0.005),
                        foot,
                        (size, size * 0.7),
                        table.feet,
                        1.0,
                        _X,
                        level=True,
                    )
                )
        z = float(rng.uniform(0.15, 0.3))
        meshes.append(beam((-reach * 0.85, y, z), (reach * 0.85, y, z), (size * 0.7, size), table.feet))
        for x in (0.9 * reach, -0.9 * reach):
            thin = (size * 0.6, size * 0.6)
            meshes.append(beam((x, y - lean, z), (x, y + lean, z), thin, table.feet, across=_X))
    return meshes


def columns(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A trestle table of old: a post at each end on a foot across, a beam between them."""
    at, size = table.width / 2.0 * float(rng.uniform(0.55, 0.75)), float(rng.uniform(0.07, 0.14))
    reach, foot = table.depth * float(rng.uniform(0.35, 0.45)), float(rng.uniform(0.05, 0.09))
    meshes = []
    for y in (-at, at):
        meshes.append(block(0.0, y, 0.0, 2.0 * reach, size, foot, table.feet))
        meshes.append(block(0.0, y, table.under - 0.05, 1.8 * reach, size, 0.05, table.feet))
        if rng.random() < 0.5:
            meshes.append(block(0.0, y, foot, size * 1.6, size * 0.8, table.under - foot, table.feet))
        else:
            for x in (-0.3 * reach, 0.3 * reach):
                meshes.append(block(x, y, foot, size * 0.7, size * 0.8, table.under - foot, table.feet))
    z = float(rng.choice([0.12, 0.3, table.under - 0.12]))
    meshes.append(beam((0.0, -at, z), (0.0, at, z), (0.05, 0.09), table.feet, across=_X))
    return meshes


def slabs(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Two upright boards near the ends, or flush with them, and perhaps a rail."""
    thick = float(rng.choice([0.025, 0.04, 0.06]))
    at = table.width / 2.0 - thick / 2.0 - float(rng.choice([0.0, 0.1, 0.3]))
    deep = table.depth * float(rng.choice([1.0, 0.85, 0.6]))
    meshes = [block(0.0, y, 0.0, deep, thick, table.under, table.feet) for y in (-at, at)]
    if rng.random() < 0.6:
        tall = float(rng.uniform(0.08, 0.3))
        meshes.append(block(0.0, 0.0, table.under - tall, 0.025, 2.0 * at, tall, table.feet))
    return meshes


def crosses(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Legs that cross in an X at each end, joined by a bar."""
    at, size = table.width / 2.0 * float(rng.uniform(0.6, 0.85)), float(rng.uniform(0.035, 0.09))
    reach, meshes = table.depth / 2.0 - 0.08, []
    half = size / 2.0
    # Where they lie flatter than they stand they are broader across.
    section = (size, size * 0.8) if 2.0 * reach < 0.98 * table.under else (size * 0.8, size)
    for y in (-at, at):
        for way in (-1.0, 1.0):
            start, end = (way * reach, y + way * half * 0.4, 0.0), (-way * reach, y + way * half * 0.4, table.under)
            meshes.append(beam(start, end, section, table.feet, across=_X, level=True))
        meshes.append(block(0.0, y, table.under - 0.03, 2.0 * reach + size, size, 0.03, table.feet))
    z, thin = table.under / 2.0, (size * 0.8, size * 0.8)
    meshes.append(beam((0.0, -at, z), (0.0, at, z), thin, table.feet, across=_X))
    return meshes


def hoops(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A frame of metal at each end: a rectangle, a trapezium or a V of flat bar."""
    size, at = float(rng.uniform(0.03, 0.09)), table.width / 2.0 - float(rng.uniform(0.05, 0.3))
    upper = (table.depth / 2.0 - 0.05) * float(rng.choice([1.0, 1.0, 0.55]))
    lower = (table.depth / 2.0 - 0.05) * float(rng.choice([1.0, 1.0, 0.6]))
    material, meshes = metal(rng), []
    thin = size * float(rng.choice([1.0, 0.4]))
    for y in (-at, at):
        for way in (-1.0, 1.0):
            meshes.append(
                beam((way * lower, y, 0.0), (way * upper, y, table.under), (thin, size), material, 1.0, _X, level=True)
            )
        for z, half in ((0.0, lower), (table.under - thin, upper)):
            meshes.append(block(0.0, y, z, 2.0 * half + thin, size, thin, material))
    if table.top.opacity < 1.0 or rng.random() < 0.4:
        meshes.append(block(0.0, 0.0, table.under - 0.03, 0.05, 2.0 * at, 0.03, material))
    return meshes


def hairpins(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Bent rods: four hairpin legs, or the folding kind, a U of tube at each end with a brace."""
    material = metal(rng)
    if rng.random() < 0.5:
        meshes = []
        for x, y in table.corners(0.12):
            foot = np.array([x * 1.06, y * 1.06, 0.004])
            for dx, dy in ((0.07, 0.0), (0.0, 0.07)):
                meshes.append(tube(foot, (x - np.sign(x) * dx, y - np.sign(y) * dy, table.under), 0.006, material))
        return meshes
    radius, reach = float(rng.uniform(0.011, 0.016)), table.depth / 2.0 * (0.6 if table.round_ else 0.82)
    meshes = []
    at = table.width / 2.0 * (0.55 if table.round_ else 0.75)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 7)
    arc = np.stack([np.zeros(7), reach - 0.05 + 0.05 * np.cos(turn), radius + 0.05 + 0.05 * np.sin(turn)], axis=1)[:4]
    right = [(x, z) for _, x, z in arc]
    path = [(-reach, table.under), *((-x, z) for x, z in right[::-1]), *right, (reach, table.under)]
    for side in (-1.0, 1.0):
        y = side * at
        meshes.append(rod([(x, y, z) for x, z in path], radius, material, ends=False))
        z = float(rng.uniform(0.3, 0.45))
        meshes.append(tube((-reach, y, z), (reach, y, z), radius * 0.8, material))
        meshes.append(tube((0.0, y, z), (0.0, y - side * at * 0.55, table.under), radius * 0.7, material))
    return meshes
