"""Pots that plants stand in."""

from __future__ import annotations

import colorsys

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.materials.plain import drawn_colour, plastic, shading, wood
from edgemap.simulation.apartment.made.shapes.bars import tube
from edgemap.simulation.apartment.made.shapes.lofts import lathe, plate
from edgemap.simulation.apartment.made.shapes.outlines import oval, rectangle
from edgemap.simulation.apartment.made.shapes.solids import block
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Material, Mesh, Part

_SOIL = Material((0.03, 0.018, 0.01))


def pot(rng: np.random.Generator, radius: float, height: float) -> tuple[list[Mesh], float]:
    """A pot about the origin on the floor, radius at its rim; on a saucer or legs or not.

    Returns it and how high its soil lies, metres.
    """
    material, way, lift, meshes = _clay(rng), rng.random(), 0.0, []
    if way < 0.18:
        taper = float(rng.choice([1.0, 0.9, 0.75]))
        shape = (
            rectangle(1.9 * radius, 1.9 * radius)
            if rng.random() < 0.7
            else oval(2 * radius, 2 * radius, 5.0, points=40)
        )
        rim = plate(shape, height - 0.012, height, material)
        body = plate(shape * 0.985, 0.0, height - 0.012, material, taper)
        return [body, rim, plate(shape * 0.88, height - 0.005, height + 0.001, _SOIL)], height
    if way < 0.3:
        meshes, lift = _stand(rng, radius, height)
    elif way < 0.5:
        saucer = np.array([0.0, 1.0, 1.25, 1.25, 1.15, 1.0, 0.0]) * radius * 0.85
        meshes = [Mesh((lathe(saucer, np.array([0.0, 0.0, 0.02, 0.025, 0.018, 0.008, 0.008]), material),))]
        lift = 0.01
    up = np.linspace(0.0, 1.0, 17)
    foot, belly = float(rng.uniform(0.55, 0.8)), float(rng.uniform(1.05, 1.35))
    style = int(rng.integers(6))
    profile = (
        PchipInterpolator([0.0, 1.0], [foot, 1.0]),
        PchipInterpolator([0.0, 0.05, 1.0], [0.95, 1.0, 1.0]),
        PchipInterpolator([0.0, 0.8, 0.801, 0.99, 1.0], [foot * 0.95, 0.9, 1.0, 1.02, 1.0]),
        PchipInterpolator([0.0, 0.5, 1.0], [foot, belly, 1.0]),
        PchipInterpolator([0.0, 0.3, 0.7, 1.0], [foot * 0.8, 0.92, 1.0, 0.95]),
        PchipInterpolator([0.0, 0.08, 0.16, 0.6, 0.9, 1.0], [foot, foot, foot * 0.6, 0.85, 0.9, 1.05]),
    )[style]
    radii, heights = profile(up) * radius, lift + up * height
    inner = np.array([radii[-1], radii[-1] * 0.93, radii[-1] * 0.9])
    soil = lift + height * 0.93
    parts: list[Part] = [
        lathe(np.concatenate([[0.0], radii]), np.concatenate([[lift], heights]), material),
        lathe(inner, np.array([heights[-1], heights[-1], soil - 0.005]), material),
        lathe(np.array([radii[-1] * 0.93, 0.0]), np.array([soil, soil]), _SOIL),
    ]
    return [*meshes, Mesh(tuple(parts))], soil


def _clay(rng: np.random.Generator) -> Material:
    way = rng.random()
    if way < 0.25:
        r, g, b = colorsys.hsv_to_rgb(
            float(rng.uniform(0.02, 0.06)), float(rng.uniform(0.55, 0.8)), float(rng.uniform(0.2, 0.5))
        )
        return Material((r, g, b))
    if way < 0.4:
        return wood(rng)
    if way < 0.55:  # Wicker.
        row, column = np.mgrid[0:64, 0:64]
        over = (row // 2 + column // 2) % 2
        weave = shading(150.0 + 75.0 * over + 6.0 * noise(rng, 64, 64), 1.0)
        r, g, b = colorsys.hsv_to_rgb(0.09, float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.15, 0.6)))
        return Material((r, g, b), weave)
    if way < 0.75:
        return plastic(rng)
    return Material(drawn_colour(rng, 0.7), gloss=float(rng.uniform(0.0, 0.5)))


def _stand(rng: np.random.Generator, radius: float, height: float) -> tuple[list[Mesh], float]:
    """Legs round the pot, which hold it off the floor."""
    material = wood(rng) if rng.random() < 0.6 else plastic(rng)
    lift, count, meshes = height * float(rng.uniform(0.25, 0.7)), int(rng.choice([3, 4])), []
    at = radius * 0.8
    for turn in np.arange(count) * 2.0 * np.pi / count + 0.4:
        way = np.array([np.cos(turn), np.sin(turn), 0.0])
        meshes.append(tube(way * at * 1.1, way * at * 0.8 + [0.0, 0.0, lift + 0.01], radius * 0.07, material))
    meshes.append(block(0.0, 0.0, lift - 0.015, at * 1.1, at * 1.1, 0.015, material))
    return meshes, lift
