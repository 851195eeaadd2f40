"""What kitchen machines and bathroom china are finished with."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import TEXTURE_PX, drawn_colour, shading
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Material


def finish(rng: np.random.Generator, coloured: float) -> Material:
    """Enamel white, cream, grey or black, brushed steel, or with the given chance any colour."""
    if rng.random() < coloured:
        return Material(drawn_colour(rng, 0.9), gloss=float(rng.uniform(0.2, 0.5)))
    way = rng.random()
    if way < 0.42:
        value, gloss = float(rng.uniform(0.6, 0.8)), float(rng.uniform(0.1, 0.4))
        return Material((value, value, value * float(rng.uniform(0.9, 1.0))), gloss=gloss)
    if way < 0.75:
        value = float(rng.uniform(0.22, 0.55))
        brushed = 1.0 + 0.025 * noise(rng, TEXTURE_PX, TEXTURE_PX, stretch=24.0, slope=0.5)
        return Material((value, value, value * 1.02), shading(brushed, 228.0), gloss=float(rng.uniform(0.4, 0.65)))
    value = float(rng.choice([0.02, 0.04, 0.12, 0.3]))
    return Material((value, value, value), gloss=float(rng.uniform(0.2, 0.5)))


def china_of(rng: np.random.Generator) -> Material:
    """Glazed white, now and then cream, grey, black or a pastel colour."""
    if rng.random() < 0.12:
        if rng.random() < 0.25:
            return Material((0.04, 0.04, 0.042), gloss=0.5)
        red, green, blue = drawn_colour(rng, 0.35)
        lift = 0.6 / max(red, green, blue)
        return Material((red * lift, green * lift, blue * lift), gloss=0.4)
    value = float(rng.uniform(0.66, 0.82))
    return Material((value, value * 0.995, value * float(rng.uniform(0.9, 1.0))), gloss=float(rng.uniform(0.25, 0.5)))
