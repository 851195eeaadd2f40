"""Vases, turned on a lathe."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.materials.plain import drawn_colour
from edgemap.simulation.apartment.made.shapes.lofts import lathe
from edgemap.simulation.render.mesh import Material, Mesh


def vase(rng: np.random.Generator) -> Mesh:
    """A turned body: foot, belly, neck and lip, glazed in one colour with or without a band."""
    height = float(rng.uniform(0.22, 0.55))
    belly, at = float(rng.uniform(0.2, 0.38)) * height, float(rng.uniform(0.3, 0.65))
    foot, neck = belly * float(rng.uniform(0.45, 0.8)), belly * float(rng.uniform(0.22, 0.6))
    lip = neck * float(rng.uniform(1.05, 1.5))
    radius = PchipInterpolator([0.0, at, float(rng.uniform(0.8, 0.9)), 1.0], [foot, belly, neck, lip])
    up = np.linspace(0.0, 1.0, 25)
    outer, inner = radius(up), np.maximum(radius(up[::-1]) - 0.006, 0.004)
    glaze = Material(drawn_colour(rng), gloss=float(rng.uniform(0.1, 0.5)))
    parts = [lathe(outer, up * height, glaze), lathe(inner, up[::-1] * height, Material((0.03, 0.03, 0.03)))]
    if rng.random() < 0.5:
        low = float(rng.uniform(0.2, 0.6))
        band = np.linspace(low, low + float(rng.uniform(0.08, 0.25)), 9)
        parts.append(lathe(radius(band) + 0.0015, band * height, Material(drawn_colour(rng), gloss=0.3)))
    return Mesh(tuple(parts))
