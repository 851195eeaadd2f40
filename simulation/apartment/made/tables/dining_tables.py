"""Dining tables: any top on any feet, bare or under a cloth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import fabric
from edgemap.simulation.apartment.made.materials.plain import metal, plastic, wood
from edgemap.simulation.apartment.made.shapes.grids import surface
from edgemap.simulation.apartment.made.shapes.lofts import plate
from edgemap.simulation.apartment.made.shapes.outlines import oval, rectangle
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block
from edgemap.simulation.apartment.made.tables.feet import FEET_LONG, FEET_SQUARE
from edgemap.simulation.apartment.made.tables.frames import slabs
from edgemap.simulation.apartment.made.tables.table import Feet, Table
from edgemap.simulation.render.mesh import Array, Material, Mesh


def dining_table(rng: np.random.Generator) -> Mesh:
    """A rectangular, square, oval or round table, 0.70 to 0.78 m high, its long side across its front."""
    height, thickness = float(rng.uniform(0.7, 0.78)), float(rng.choice([0.018, 0.025, 0.03, 0.04, 0.06]))
    way, squareness = rng.random(), 0.0
    if way < 0.55:
        depth, width = float(rng.uniform(0.7, 1.05)), float(rng.uniform(1.1, 2.3))
        squareness = float(rng.choice([0.0, 0.0, 0.0, 12.0, 6.0]))
    elif way < 0.68:
        depth = width = float(rng.uniform(0.7, 1.1))
        squareness = float(rng.choice([0.0, 0.0, 8.0]))
    elif way < 0.8:
        depth, width = float(rng.uniform(0.85, 1.15)), float(rng.uniform(1.3, 2.2))
        squareness = float(rng.uniform(2.0, 3.0))
    else:
        depth = width = float(rng.uniform(0.75, 1.45))
        squareness = 2.0
    round_ = 0.0 < squareness <= 3.0
    outline = oval(depth, width, squareness, points=40) if squareness else rectangle(depth, width)
    top = _top_material(rng)
    if top.opacity < 1.0:
        thickness = float(rng.uniform(0.01, 0.016))
    same = rng.random() < 0.55 and top.opacity == 1.0
    table = Table(depth, width, height - thickness, round_, top, top if same else _feet_material(rng))
    choices = FEET_LONG if width > 1.35 * depth else FEET_SQUARE
    if round_:
        choices = tuple(feet for feet in choices if feet is not slabs)
    meshes = _feet(rng, choices)(rng, table)
    meshes += _top(rng, outline, table, thickness, squareness)
    if rng.random() < 0.14:
        meshes.append(_cloth(rng, outline * 1.01, height + 0.002, fabric(rng)))
    return joined(meshes)


def _feet(rng: np.random.Generator, choices: tuple[Feet, ...]) -> Feet:
    return choices[int(rng.integers(len(choices)))]


def _top_material(rng: np.random.Generator) -> Material:
    way = rng.random()
    if way < 0.16:
        value = float(rng.uniform(0.1, 0.6))
        return Material((value, value * 1.05, value * 1.03), opacity=float(rng.uniform(0.25, 0.6)), gloss=0.8)
    if way < 0.34:
        return plastic(rng)
    return wood(rng)


def _feet_material(rng: np.random.Generator) -> Material:
    way = rng.random()
    return metal(rng) if way < 0.4 else wood(rng) if way < 0.75 else plastic(rng)


def _top(rng: np.random.Generator, outline: Array, table: Table, thickness: float, squareness: float) -> list[Mesh]:
    """One plate, with a slanted edge or not; or boards, or two halves that draw apart."""
    way = rng.random()
    if squareness or table.top.opacity < 1.0 or way < 0.65:
        taper = float(rng.choice([1.0, 1.0, 0.98, 0.94]))
        return [plate(outline, table.under, table.under + thickness, table.top, taper)]
    count = 2 if way < 0.8 else int(rng.integers(3, 8))
    across = count > 2 and rng.random() < 0.75
    size = (table.depth if across else table.width) / count
    meshes = []
    for i in range(count):
        shade = float(rng.uniform(0.75, 1.1)) if count > 2 else 1.0
        r, g, b = (min(channel * shade, 0.9) for channel in table.top.colour)
        material = replace(table.top, colour=(r, g, b))
        at, gap = (i - (count - 1) / 2.0) * size, 0.003
        if across:
            meshes.append(block(at, 0.0, table.under, size - gap, table.width, thickness, material))
        else:
            meshes.append(block(0.0, at, table.under, table.depth, size - gap, thickness, material))
    return meshes


def _cloth(rng: np.random.Generator, outline: Array, height: float, material: Material) -> Mesh:
    """A table cloth: flat on the top, in folds round it, longer at corners."""
    drop, count = float(rng.uniform(0.12, 0.5)), 144
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], count + 1)
    ring = np.column_stack([np.interp(at, length, outline[:, i]) for i in range(2)])
    outward = ring / np.linalg.norm(ring, axis=1, keepdims=True)
    folds = int(length[-1] / float(rng.uniform(0.18, 0.35)))
    wave = 1.0 + np.sin(at / length[-1] * 2.0 * np.pi * folds + 2.0 * np.sin(at / length[-1] * 4.0 * np.pi))
    rows = []
    for part in np.linspace(1.0, 0.0, 6):
        away = 0.004 + 0.014 * np.sqrt(part) + 0.03 * part * wave * min(1.0, drop / 0.3)
        rows.append(np.column_stack([ring + outward * away[:, None], np.full(count + 1, height - drop * part)]))
    skirt = surface(np.stack(rows), material)
    skirt = replace(skirt, uv=skirt.uv * [float(length[-1]), drop])
    return joined([plate(ring * 1.004, height - 0.003, height, material), Mesh((skirt,))])
