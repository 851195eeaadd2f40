"""Televisions."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK, drawn_colour
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Material, Mesh, box, quad


def tv(rng: np.random.Generator) -> Mesh:
    """A flat screen on a foot or two, dark or showing something."""
    width = float(rng.uniform(0.6, 1.15))
    height, lift = width * 0.57, float(rng.uniform(0.04, 0.1))
    case = Material((0.35, 0.35, 0.36), gloss=0.3) if rng.random() < 0.2 else BLACK
    rim = float(rng.uniform(0.012, 0.03))
    meshes = [box((-0.025, -width / 2, lift), (0.022, width / 2, lift + height), case)]
    screen = BLACK if rng.random() < 0.6 else Material(drawn_colour(rng, 0.5))
    u, v = np.array([0.0, width - 2 * rim, 0.0]), np.array([0.0, 0.0, height - 2 * rim])
    face = quad(np.array([0.0235, -width / 2 + rim, lift + rim]), u, v, Material(screen.colour, gloss=0.5))
    meshes.append(Mesh((face,)))
    if rng.random() < 0.5:
        meshes += [box((-0.03, -0.04, 0.0), (0.0, 0.04, lift), case), box((-0.1, -0.2, 0.0), (0.1, 0.2, 0.012), case)]
    else:
        for y in (-width * 0.35, width * 0.35):
            meshes.append(box((-0.1, y - 0.015, 0.0), (0.1, y + 0.015, lift), case))
    return joined(meshes)
