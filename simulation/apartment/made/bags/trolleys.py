"""Trolley suitcases."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK, STEEL, drawn_colour
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Material, Mesh, box


def suitcase(rng: np.random.Generator) -> Mesh:
    """An upright trolley: shell with ribs and rounded edges, seam, four wheels and a handle, drawn out or not."""
    width, height = float(rng.uniform(0.34, 0.48)), float(rng.uniform(0.5, 0.72))
    depth = width * float(rng.uniform(0.5, 0.62))
    shell = Material(drawn_colour(rng, 0.9), gloss=float(rng.uniform(0.0, 0.35)))
    wheel, round_ = 0.05, 0.035
    low, high = np.array([-depth / 2, -width / 2, wheel]), np.array([depth / 2, width / 2, wheel + height])
    meshes = [
        box(low + np.roll([0.0, round_, round_], axis), high - np.roll([0.0, round_, round_], axis), shell)
        for axis in range(3)
    ]
    inset = round_ * 0.3
    meshes.append(box(low + inset, high - inset, shell))
    meshes.append(box(low + [depth / 2 - 0.006, -0.002, -0.002], high - [depth / 2 - 0.006, -0.002, -0.002], BLACK))
    ribs = int(rng.integers(0, 7))
    for y in np.linspace(-width / 2 + 0.07, width / 2 - 0.07, ribs) if ribs > 1 else []:
        for x in (low[0] - 0.006, high[0] - 0.002):
            meshes.append(box((x, y - 0.012, wheel + 0.06), (x + 0.008, y + 0.012, wheel + height - 0.06), shell))
    for x in (low[0] + 0.05, high[0] - 0.05):
        for y in (low[1] + 0.05, high[1] - 0.05):
            meshes.append(box((x - 0.022, y - 0.014, 0.0), (x + 0.022, y + 0.014, wheel + 0.02), BLACK))
    meshes.append(box((-0.012, -0.08, wheel + height), (0.012, 0.08, wheel + height + 0.025), BLACK))
    if rng.random() < 0.5:
        top, back = wheel + height + float(rng.uniform(0.25, 0.42)), low[0] + 0.03
        for y in (-0.09, 0.09):
            meshes.append(box((back - 0.008, y - 0.008, wheel + height - 0.02), (back + 0.008, y + 0.008, top), STEEL))
        meshes.append(box((back - 0.014, -0.105, top), (back + 0.014, 0.105, top + 0.03), BLACK))
    return joined(meshes)
