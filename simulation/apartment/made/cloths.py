"""What seats are covered with."""

from __future__ import annotations

import colorsys

import numpy as np

from edgemap.simulation.apartment.made.shapes import fabric
from edgemap.simulation.render.mesh import Material

_CELLS, _CELL_PX = 16, 8


def leather(rng: np.random.Generator) -> Material:
    """Black, brown, cognac, red or cream."""
    hue, saturation = float(rng.uniform(0.01, 0.09)), float(rng.uniform(0.1, 0.75))
    value = float(np.exp(rng.uniform(np.log(0.02), np.log(0.65))))
    return Material(colorsys.hsv_to_rgb(hue, saturation, value), gloss=float(rng.uniform(0.1, 0.4)))


def upholstery(rng: np.random.Generator) -> Material:
    """Leather or cloth; most of it in the greys, browns and blues that sofas are sold in."""
    way = rng.random()
    if way < 0.3:
        return leather(rng)
    cloth = fabric(rng)
    if way < 0.5:
        return cloth
    hue = float(rng.choice([rng.uniform(0.05, 0.13), rng.uniform(0.5, 0.66), rng.random()]))
    value = float(np.exp(rng.uniform(np.log(0.03), np.log(0.7))))
    return Material(colorsys.hsv_to_rgb(hue, float(rng.uniform(0.0, 0.4)), value), cloth.texture)


def woven(rng: np.random.Generator) -> Material:
    """Cane, rush or rattan."""
    wave = np.abs(np.sin(np.linspace(0.0, np.pi, _CELL_PX)))
    strand = 0.45 + 0.55 * np.broadcast_to(wave[:, None], (_CELL_PX, _CELL_PX))
    cell = np.block([[strand, strand.T], [strand.T, strand]])
    field = np.tile(cell, (_CELLS // 2, _CELLS // 2)) * rng.uniform(0.9, 1.0, (_CELLS * _CELL_PX, _CELLS * _CELL_PX))
    texels = np.full((*field.shape, 4), 255, dtype=np.uint8)
    texels[..., :3] = (field[..., None] * 255.0).astype(np.uint8)
    value = float(np.exp(rng.uniform(np.log(0.05), np.log(0.7))))
    return Material(colorsys.hsv_to_rgb(float(rng.uniform(0.06, 0.12)), float(rng.uniform(0.2, 0.65)), value), texels)
