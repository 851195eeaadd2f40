"""What seats are covered with, beds made up with and bags sewn from."""

from __future__ import annotations

import colorsys

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import TEXTURE_PX, drawn_colour, shading
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Material

_CELLS, _CELL_PX = 16, 8


def fabric(rng: np.random.Generator) -> Material:
    """Cloth: plain, mottled, striped or checked; now and then leather."""
    colour = drawn_colour(rng, 0.7)
    way = rng.random()
    if way < 0.2:
        return Material(colour, gloss=float(rng.uniform(0.1, 0.3)))
    field = 1.0 + float(rng.uniform(0.02, 0.1)) * noise(rng, TEXTURE_PX, TEXTURE_PX, slope=float(rng.uniform(0.1, 1.2)))
    if way > 0.6:
        bands = np.arange(TEXTURE_PX) * int(rng.integers(2, 12)) // TEXTURE_PX % 2
        both = np.maximum(bands[:, None], bands[None]) if way > 0.8 else np.broadcast_to(bands, field.shape)
        field = field * np.where(both, float(rng.uniform(0.4, 0.9)), 1.0)
    return Material(colour, shading(field))


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
    value = float(np.exp(rng.uniform(np.log(0.05), np.log(0.7))))
    return Material(
        colorsys.hsv_to_rgb(float(rng.uniform(0.06, 0.12)), float(rng.uniform(0.2, 0.65)), value), shading(field, 255.0)
    )


def linen(rng: np.random.Generator) -> Material:
    """A sheet's cloth: white, or one pale or strong colour."""
    value = float(rng.uniform(0.5, 0.8))
    if rng.random() < 0.6:
        return Material((value, value * 0.98, value * 0.95))
    return Material(drawn_colour(rng, 0.5))


def bag_cloth(rng: np.random.Generator) -> Material:
    """What bags are sewn from: black, grey or navy more often than not, else any cloth."""
    if rng.random() < 0.45:
        value = float(rng.uniform(0.015, 0.12))
        return Material(
            (value, value * float(rng.uniform(0.95, 1.1)), value * float(rng.uniform(1.0, 1.7))), gloss=0.08
        )
    return fabric(rng)
