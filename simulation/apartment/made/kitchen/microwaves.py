"""Microwave ovens."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.finishes import finish
from edgemap.simulation.apartment.made.materials.plain import BLACK, CHROME, GLASS, RUBBER, STEEL
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.outlines import arc
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Material, Mesh, box


def microwave(rng: np.random.Generator) -> Mesh:
    """A low box on feet: a dark window in a door on the left, keys or dials and a display to its right."""
    width, height = float(rng.uniform(0.42, 0.56)), float(rng.uniform(0.24, 0.33))
    depth, foot = float(rng.uniform(0.3, 0.42)), float(rng.uniform(0.008, 0.018))
    case = finish(rng, 0.2)
    front = case if rng.random() < 0.6 else (finish(rng, 0.1) if rng.random() < 0.5 else BLACK)
    half, radius = width / 2.0, float(rng.uniform(0.004, 0.03))
    meshes = [rounded((0.0, -half, foot), (depth, half, foot + height), case, radius, 0.004, axis=0)]
    for x in (0.04, depth - 0.04):
        for y in (-half + 0.04, half - 0.04):
            meshes.append(block(x, y, 0.0, 0.03, 0.03, foot + 0.005, BLACK))
    face, low, high = depth + 0.022, foot + 0.003, foot + height - 0.003
    cut = half - width * float(rng.uniform(0.68, 0.78))
    panel = front if rng.random() < 0.5 else BLACK
    meshes.append(rounded((depth - 0.002, cut + 0.002, low), (face, half - 0.002, high), front, radius, 0.004, axis=0))
    meshes.append(
        rounded((depth - 0.002, -half + 0.002, low), (face, cut - 0.002, high), panel, radius * 0.5, 0.004, axis=0)
    )
    rim = float(rng.uniform(0.025, 0.055))
    window = ((face - 0.004, cut + rim + 0.02, low + rim), (face + 0.002, half - rim, high - rim))
    meshes.append(rounded(*window, GLASS, float(rng.uniform(0.003, 0.03)), 0.001, axis=0))
    if rng.random() < 0.5:
        inner = np.array(window) + [[0.0, 0.03, 0.025], [0.0005, -0.03, -0.025]]
        meshes.append(box(inner[0], inner[1], Material((0.05, 0.05, 0.048), gloss=0.4)))
    meshes.append(_microwave_handle(rng, face, cut, low, high))
    meshes += _panel(rng, face, (-half, cut), (low, high), max(panel.colour) < 0.2)
    for z in np.linspace(foot + height * 0.5, foot + height * 0.75, 5) if rng.random() < 0.7 else []:
        for y in (-half - 0.0005, half - 0.0005):
            meshes.append(box((depth * 0.2, y, z), (depth * 0.6, y + 0.001, z + 0.006), RUBBER))
    return joined(meshes)


def _microwave_handle(rng: np.random.Generator, face: float, cut: float, low: float, high: float) -> Mesh:
    way, y = rng.random(), cut + 0.022
    bar = (CHROME, STEEL, BLACK)[int(rng.integers(3))]
    if way < 0.45:
        ends = np.array([[face + 0.03, y, low + 0.03], [face + 0.03, y, high - 0.03]])
        posts = [tube((face - 0.002, y, z), (face + 0.03, y, z), 0.006, bar) for z in (low + 0.045, high - 0.045)]
        return joined([tube(ends[0], ends[1], 0.008, bar), *posts])
    if way < 0.65:
        bow = arc((face - 0.003, y, low + 0.03), (face - 0.003, y, high - 0.03), (0.035, 0, 0))
        return rod(bow, 0.007, bar, across=(0.0, 1.0, 0.0))
    return box((face - 0.01, cut + 0.004, low + 0.01), (face + 0.001, cut + 0.014, high - 0.01), RUBBER)


def _panel(
    rng: np.random.Generator, face: float, ys: tuple[float, float], zs: tuple[float, float], dark: bool
) -> list[Mesh]:
    """Display and keys, or two dials, between y and z limits."""
    y, wide, tall = (ys[0] + ys[1]) / 2.0, ys[1] - ys[0], zs[1] - zs[0]
    key = Material((0.4, 0.4, 0.4)) if dark else Material((0.12, 0.12, 0.13))
    if rng.random() < 0.3:
        ring = STEEL if dark else Material((0.2, 0.2, 0.2), gloss=0.3)
        radius = min(wide * 0.3, 0.032)
        return [
            tube((face - 0.002, y, zs[0] + tall * s), (face + 0.022, y, zs[0] + tall * s), radius, ring)
            for s in (0.3, 0.7)
        ]
    digit = Material((0.05, 0.05, 0.05), emission=(0.1, 0.5, 0.3) if rng.random() < 0.6 else (0.2, 0.4, 0.6))
    meshes = [
        block(face - 0.002, y, zs[1] - tall * 0.22, 0.006, wide * 0.7, tall * 0.13, GLASS),
        block(face - 0.001, y, zs[1] - tall * 0.18, 0.006, wide * 0.4, tall * 0.055, digit),
    ]
    rows = int(rng.integers(3, 6))
    for z in np.linspace(zs[0] + tall * 0.12, zs[0] + tall * 0.62, rows):
        for dy in (-0.25, 0.0, 0.25):
            meshes.append(block(face - 0.001, y + dy * wide, z, 0.005, wide * 0.17, tall * 0.05, key))
    return meshes
