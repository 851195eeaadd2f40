"""Wood, plastic and metal, and what others are coloured and shaded by."""

from __future__ import annotations

import colorsys

import numpy as np

from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Array, Material

BLACK = Material((0.015, 0.015, 0.017), gloss=0.25)
RUBBER = Material((0.03, 0.03, 0.032))
STEEL = Material((0.45, 0.45, 0.46), gloss=0.5)
CHROME = Material((0.6, 0.6, 0.62), gloss=0.6)
BRASS = Material((0.45, 0.33, 0.12), gloss=0.5)
GLASS = Material((0.012, 0.012, 0.014), gloss=0.6)
TEXTURE_PX = 128


def drawn_colour(rng: np.random.Generator, saturation: float = 0.8) -> tuple[float, float, float]:
    """Any colour, linear, up to this saturation."""
    value = float(rng.uniform(0.08, 0.75))
    return colorsys.hsv_to_rgb(float(rng.random()), float(rng.uniform(0.0, saturation)), value)


def shading(field: Array, white: float = 225.0) -> np.ndarray:
    """A texture (H, W, 4) that only shades a colour, by a field (H, W) about 1; white: what 1 is, of 255."""
    texels = np.full((*field.shape, 4), 255, dtype=np.uint8)
    texels[..., :3] = np.clip(field[..., None] * white, 0.0, 255.0).astype(np.uint8)
    return texels


def wood(rng: np.random.Generator) -> Material:
    """Oiled, stained or painted wood, with or without grain."""
    if rng.random() < 0.3:
        return Material(drawn_colour(rng, 0.4), gloss=float(rng.uniform(0.0, 0.3)))
    hue, value = float(rng.uniform(0.05, 0.11)), float(np.exp(rng.uniform(np.log(0.06), np.log(0.75))))
    colour = colorsys.hsv_to_rgb(hue, float(rng.uniform(0.25, 0.7)), value)
    grain = noise(rng, TEXTURE_PX, TEXTURE_PX, stretch=float(rng.uniform(6.0, 20.0)), slope=0.8)
    return Material(colour, shading(1.0 + 0.07 * grain), gloss=float(rng.uniform(0.0, 0.25)))


def plastic(rng: np.random.Generator) -> Material:
    """Moulded plastic or lacquer in any colour, often white or black."""
    if rng.random() < 0.4:
        value = float(rng.choice([0.02, 0.1, 0.6, 0.75]))
        return Material((value, value, value), gloss=float(rng.uniform(0.0, 0.4)))
    return Material(drawn_colour(rng), gloss=float(rng.uniform(0.05, 0.4)))


def metal(rng: np.random.Generator) -> Material:
    """Steel, chrome, brass or painted black."""
    colours = ((0.45, 0.45, 0.46), (0.6, 0.6, 0.62), (0.45, 0.33, 0.12), (0.02, 0.02, 0.02), (0.7, 0.7, 0.7))
    return Material(colours[int(rng.integers(len(colours)))], gloss=float(rng.uniform(0.2, 0.6)))
