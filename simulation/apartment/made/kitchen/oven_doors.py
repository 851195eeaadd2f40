"""Doors and knobs of ovens."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK, CHROME, GLASS, STEEL, drawn_colour
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.outlines import arc
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Material, Mesh

# A door at a depth between y0 and y1, z0 and z1; a knob on a face at y and z with a radius.
Door = Callable[[float, float, float, float, float], Mesh]
Knob = Callable[[float, float, float, float], Mesh]


def door_maker(rng: np.random.Generator, front: Material) -> Door:
    """One way of oven doors for one cooker: framed or all glass, with a bar along the top."""
    framed, away = rng.random() < 0.55, float(rng.uniform(0.035, 0.055))
    bar, thick = (
        (CHROME, STEEL, BLACK, front)[int(rng.choice(4, p=[0.35, 0.35, 0.15, 0.15]))],
        float(rng.uniform(0.008, 0.013)),
    )
    bowed, round_ = rng.random() < 0.25, float(rng.uniform(0.004, 0.05))
    racks, cloth = rng.random() < 0.5, rng.random() < 0.15
    towel = Material(drawn_colour(rng, 0.9))
    share, tall = float(rng.uniform(0.6, 0.82)), float(rng.uniform(0.45, 0.62))

    def door(depth: float, y0: float, y1: float, z0: float, z1: float) -> Mesh:
        face, wide, high = depth + 0.03, y1 - y0, z1 - z0
        meshes = [rounded((depth, y0, z0), (face, y1, z1), front if framed else GLASS, 0.008, 0.005, axis=0)]
        y, z = (y0 + y1) / 2.0, z0 + high * 0.44
        a, b = wide * share / 2.0, high * tall / 2.0
        if framed:
            meshes.append(
                rounded((face - 0.006, y - a, z - b), (face + 0.003, y + a, z + b), GLASS, round_, 0.002, axis=0)
            )
        elif rng.random() < 0.5:
            trim = rounded((face - 0.005, y0, z1 - high * 0.2), (face + 0.002, y1, z1), front, 0.004, 0.001, axis=0)
            meshes.append(trim)
        if racks:
            inner = Material((0.05, 0.05, 0.05), gloss=0.4)
            for share_z in (-0.35, 0.25):
                meshes.append(block(face + 0.0005, y, z + b * share_z, 0.007, 1.7 * a, 0.006, inner))
        z_bar, c = z1 - max(0.045, high * 0.1), wide * 0.42
        if bowed:
            bow = arc((face - 0.004, y - c, z_bar), (face - 0.004, y + c, z_bar), (away, 0.0, 0.0), 13)
            meshes.append(rod(bow, thick, bar, across=(0.0, 0.0, 1.0)))
        else:
            meshes.append(tube((face + away, y - c, z_bar), (face + away, y + c, z_bar), thick, bar))
            for end in (y - c + 0.03, y + c - 0.03):
                meshes.append(tube((face - 0.002, end, z_bar), (face + away, end, z_bar), thick * 0.8, bar))
            if cloth and wide > 0.4:
                x, long = face + away, high * 0.5
                for at_x in (x - thick - 0.005, x + thick + 0.001):
                    meshes.append(block(at_x + 0.002, y + c * 0.3, z_bar - long, 0.005, 0.2, long, towel))
                meshes.append(block(x, y + c * 0.3, z_bar + thick - 0.003, 2 * thick + 0.01, 0.2, 0.008, towel))
        return joined(meshes)

    return door


def knob_maker(rng: np.random.Generator) -> Knob:
    """One way of knobs: plain, with a collar, with a grip across."""
    material = (BLACK, STEEL, CHROME, Material((0.7, 0.7, 0.69), gloss=0.3))[int(rng.integers(4))]
    collar, grip = rng.random() < 0.4, rng.random() < 0.5
    long = float(rng.uniform(0.016, 0.032))

    def knob(face: float, y: float, z: float, radius: float) -> Mesh:
        meshes = [tube((face - 0.002, y, z), (face + long, y, z), radius, material, radius * 0.85)]
        if collar:
            meshes.append(tube((face - 0.002, y, z), (face + 0.005, y, z), radius * 1.3, STEEL))
        if grip:
            mark = Material((0.7, 0.7, 0.7)) if max(material.colour) < 0.1 else BLACK
            meshes.append(block(face + long, y, z, 0.004, radius * 0.3, radius * 0.9, mark))
        return joined(meshes)

    return knob
