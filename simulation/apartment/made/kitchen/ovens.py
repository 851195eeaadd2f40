"""Cookers, and ovens in a housing."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.kitchen.hobs import hob
from edgemap.simulation.apartment.made.kitchen.oven_doors import Door, Knob, door_maker, knob_maker
from edgemap.simulation.apartment.made.materials.finishes import finish
from edgemap.simulation.apartment.made.materials.plain import BLACK, GLASS, RUBBER, drawn_colour, wood
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Material, Mesh, box


def oven(rng: np.random.Generator) -> Mesh:
    """A cooker with a hob, knobs and one or more dark-windowed doors, or ovens built into a housing."""
    build = str(rng.choice(["cooker", "range", "under", "tower"], p=[0.5, 0.16, 0.17, 0.17]))
    front = finish(rng, 0.2 if build == "range" else 0.06)
    width = float(rng.uniform(0.88, 1.1)) if build == "range" else float(rng.uniform(0.5, 0.76))
    depth = float(rng.uniform(0.54, 0.64))
    height = float(rng.uniform(1.0, 1.5)) if build == "tower" else float(rng.uniform(0.84, 0.93))
    half, foot = width / 2.0, float(rng.uniform(0.04, 0.11))
    body = front
    if build in {"under", "tower"}:
        body = wood(rng) if rng.random() < 0.6 else Material((0.68, 0.68, 0.67), gloss=0.2)
    elif front.texture is not None or rng.random() < 0.2:
        body = (
            Material((0.1, 0.1, 0.105), gloss=0.15) if rng.random() < 0.5 else Material((0.35, 0.35, 0.36), gloss=0.3)
        )
    meshes = [
        box((0.0, -half, foot), (depth, half, height - 0.03), body),
        box((0.03, -half + 0.02, 0.0), (depth - 0.04, half - 0.02, foot + 0.001), BLACK),
    ]
    door = door_maker(rng, front)
    knob = knob_maker(rng)
    top = height - 0.03
    if build == "tower":
        meshes.append(box((0.0, -half, height - 0.031), (depth, half, height), body))
        return joined(meshes + _tower(rng, door, knob, front, (depth, half, foot, height)))
    back_panel = float(rng.uniform(0.08, 0.24)) if build == "cooker" and rng.random() < 0.55 else 0.0
    panel_knobs = back_panel > 0.12 and rng.random() < 0.5
    slab = body if build == "under" else (front if rng.random() < 0.6 else BLACK)
    if build == "under":
        slab = wood(rng) if rng.random() < 0.5 else Material(drawn_colour(rng, 0.15), gloss=0.3)
    meshes.append(rounded((0.0, -half, top - 0.001), (depth + 0.02, half, height), slab, 0.008, 0.004))
    meshes += hob(rng, depth, half * (0.9 if build == "under" else 1.0), height)
    if back_panel:
        meshes.append(
            rounded((0.0, -half, height - 0.01), (0.05, half, height + back_panel), front, 0.01, 0.006, axis=0)
        )
        clock = block(0.05, 0.0, height + back_panel * 0.4, 0.006, width * 0.28, back_panel * 0.4, GLASS)
        meshes += [clock] if back_panel > 0.1 else []
    band = float(rng.uniform(0.02, 0.04)) if panel_knobs else float(rng.uniform(0.09, 0.13))
    strip = front if rng.random() < 0.7 else BLACK
    meshes.append(
        rounded(
            (depth - 0.01, -half + 0.002, top - band),
            (depth + 0.028, half - 0.002, top - 0.002),
            strip,
            0.006,
            0.003,
            axis=0,
        )
    )
    count = int(rng.integers(5, 9)) if build == "range" else int(rng.integers(4, 7))
    if panel_knobs:
        spots = np.concatenate([np.linspace(-0.42, -0.24, count // 2), np.linspace(0.24, 0.42, count - count // 2)])
        meshes += [knob(0.05, y * width, height + back_panel * 0.58, min(0.022, back_panel * 0.17)) for y in spots]
    else:
        meshes += _front_knobs(rng, knob, count, width, depth + 0.028, top - band / 2.0, band)
    meshes += _fronts(rng, door, front, build, (depth, half, foot + 0.004, top - band - 0.005))
    return joined(meshes)


def _front_knobs(
    rng: np.random.Generator, knob: Knob, count: int, width: float, face: float, z: float, band: float
) -> list[Mesh]:
    """A row of knobs along the band over the door, with or without a clock between them."""
    size = float(rng.uniform(0.2, 0.25)) * min(band, 0.11)
    if rng.random() < 0.5:
        return [knob(face, y * width, z, size) for y in np.linspace(-0.4, 0.4, count)]
    left = count // 2
    spots = np.concatenate([np.linspace(-0.42, -0.17, left), np.linspace(0.17, 0.42, count - left)])
    clock = block(face, 0.0, z - band * 0.25, 0.004, width * 0.2, band * 0.5, GLASS)
    digit = Material((0.1, 0.1, 0.1), emission=(0.1, 0.5, 0.35) if rng.random() < 0.5 else (0.6, 0.1, 0.05))
    shown = block(face + 0.001, 0.0, z - band * 0.1, 0.005, 0.045, band * 0.2, digit)
    return [clock, shown, *(knob(face, y * width, z, size) for y in spots)]


def _fronts(
    rng: np.random.Generator, door: Door, front: Material, build: str, sides: tuple[float, float, float, float]
) -> list[Mesh]:
    """Doors below the band: one and a drawer, one, two above each other, or two and a grill side by side."""
    depth, half, low, high = sides
    side = half - 0.003
    if build == "range":
        cut, tall = float(rng.uniform(-0.1, 0.1)) * half, float(rng.uniform(0.0, 0.3))
        ledge = low + (high - low) * (0.16 if rng.random() < 0.5 else 0.0)
        meshes = [
            door(depth, cut + 0.003, side, ledge + 0.003, high),
            door(depth, -side, cut - 0.003, ledge + 0.003, high),
        ]
        if tall > 0.15:
            middle = ledge + (high - ledge) * 0.62
            meshes = meshes[1:] + [
                door(depth, cut + 0.003, side, ledge + 0.003, middle - 0.003),
                door(depth, cut + 0.003, side, middle + 0.003, high),
            ]
        if ledge > low:
            meshes.append(
                rounded((depth, -side, low), (depth + 0.028, side, ledge - 0.003), front, 0.005, 0.004, axis=0)
            )
        return meshes
    way = rng.random()
    if way < 0.6:
        cut = low + (high - low) * float(rng.uniform(0.18, 0.28))
        drawer = rounded((depth, -side, low), (depth + 0.03, side, cut - 0.003), front, 0.006, 0.004, axis=0)
        slot = box((depth + 0.02, -side * 0.5, cut - 0.025), (depth + 0.031, side * 0.5, cut - 0.012), RUBBER)
        return [drawer, door(depth, -side, side, cut + 0.003, high), *([slot] if rng.random() < 0.5 else [])]
    if way < 0.85:
        return [door(depth, -side, side, low, high)]
    cut = low + (high - low) * float(rng.uniform(0.55, 0.65))
    return [door(depth, -side, side, low, cut - 0.003), door(depth, -side, side, cut + 0.003, high)]


def _tower(
    rng: np.random.Generator, door: Door, knob: Knob, front: Material, sides: tuple[float, float, float, float]
) -> list[Mesh]:
    """Two ovens above each other in a housing, each with a band of knobs or keys, or one band for both."""
    depth, half, low, high = sides
    side, cut = half - float(rng.uniform(0.004, 0.03)), low + (high - low) * float(rng.uniform(0.5, 0.58))
    band, both = float(rng.uniform(0.07, 0.11)), rng.random() < 0.5
    low += float(rng.uniform(0.005, 0.1))
    meshes = []
    for z0, z1, banded in ((low, cut, both), (cut + 0.006, high - 0.01, True)):
        top = z1 - band - 0.004 if banded else z1
        meshes.append(door(depth, -side, side, z0, top))
        if banded:
            strip = front if rng.random() < 0.5 else BLACK
            meshes.append(
                rounded((depth - 0.01, -side, z1 - band), (depth + 0.028, side, z1), strip, 0.005, 0.003, axis=0)
            )
            meshes += _front_knobs(rng, knob, int(rng.integers(2, 5)), 2 * side, depth + 0.028, z1 - band / 2.0, band)
    return meshes
