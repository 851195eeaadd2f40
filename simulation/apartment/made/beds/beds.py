"""Beds: singles, doubles, children's, cots and bunks, made up or half bare."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.beds.bedding import BedFrame, bedding, duvet
from edgemap.simulation.apartment.made.beds.boards import footboard, guard, headboard
from edgemap.simulation.apartment.made.materials.cloths import fabric, linen
from edgemap.simulation.apartment.made.materials.plain import metal, plastic, wood
from edgemap.simulation.apartment.made.shapes.bars import beam, rod, tube
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import ball, block, cushion
from edgemap.simulation.render.mesh import Mesh


def bed(rng: np.random.Generator) -> Mesh:
    """A bed with its head against x's low end: base, boards, mattress, and bedding in more or less order."""
    way = rng.random()
    if way < 0.05:
        return _cot(rng)
    child = way < 0.22
    if child:
        width, length = float(rng.uniform(0.7, 0.92)), float(rng.uniform(1.4, 1.9))
    else:
        width = float(rng.choice([0.9, 0.9, 1.0, 1.2, 1.4, 1.4, 1.6, 1.6, 1.8])) * float(rng.uniform(0.97, 1.03))
        length = float(rng.uniform(1.9, 2.08))
    low = float(rng.uniform(0.16, 0.32))
    high = low + float(rng.uniform(0.14, 0.2 if child else 0.3))
    style = rng.random()
    iron, padded = style < 0.2, 0.2 <= style < 0.45 and not child
    material = metal(rng) if iron else fabric(rng) if padded else plastic(rng) if style > 0.82 else wood(rng)
    frame = BedFrame(length, width, low, high, material)
    if child and rng.random() < 0.2:
        return _bunk(rng, frame)
    if iron:
        meshes = _iron(rng, frame)
    else:
        meshes = _base(rng, frame) + headboard(rng, frame, padded)
        if rng.random() < (0.7 if child else 0.35):
            meshes += footboard(rng, frame, padded)
        if child and rng.random() < 0.5:
            meshes += guard(frame, 1.0) + (guard(frame, -1.0) if rng.random() < 0.5 else [])
        elif not padded and rng.random() < 0.06:
            meshes += _canopy(rng, frame)
    return joined(meshes + bedding(rng, frame))


def _base(rng: np.random.Generator, frame: BedFrame) -> list[Mesh]:
    """A box on the floor with or without drawers, rails on feet, or a wide platform."""
    length, width, way = frame.length, frame.width, rng.random()
    if way < 0.3:
        foot = float(rng.choice([0.0, 0.0, 0.03, 0.06]))
        meshes = [block(0.0, 0.0, foot, length + 0.02, width + 0.02, frame.low + 0.02 - foot, frame.material)]
        meshes += _feet(rng, frame, foot, 0.06) if foot else []
        if rng.random() < 0.4:
            meshes += _drawers(rng, frame, foot)
        return meshes
    if way < 0.45:
        over, thick = float(rng.uniform(0.03, 0.15)), float(rng.uniform(0.05, 0.1))
        meshes = [block(over / 2, 0.0, frame.low - thick, length + over, width + 2 * over, thick, frame.material)]
        if rng.random() < 0.5:
            return meshes + _feet(rng, frame, frame.low - thick, 0.12)
        return meshes + [block(0.0, 0.0, 0.0, length - 0.3, width - 0.3, frame.low - thick, frame.material)]
    tall = float(rng.uniform(0.1, 0.22))
    under, rim = max(frame.low - tall + 0.04, 0.03), 0.03
    meshes = [
        block(0.0, s * (width + rim) / 2, under, length + 2 * rim, rim, frame.low + 0.04 - under, frame.material)
        for s in (-1.0, 1.0)
    ] + [
        block(s * (length + rim) / 2, 0.0, under, rim, width + 2 * rim, frame.low + 0.04 - under, frame.material)
        for s in (-1.0, 1.0)
    ]
    meshes.append(block(0.0, 0.0, frame.low - 0.03, length, width, 0.03, frame.material))
    return meshes + _feet(rng, frame, under, 0.02)


def _feet(rng: np.random.Generator, frame: BedFrame, height: float, inset: float) -> list[Mesh]:
    size, style, meshes = float(rng.uniform(0.04, 0.09)), rng.random(), []
    for x in (-frame.length / 2 + inset, frame.length / 2 - inset):
        for y in (-frame.width / 2 + inset, frame.width / 2 - inset):
            if style < 0.5:
                meshes.append(block(x, y, 0.0, size, size, height + 0.005, frame.material))
            else:
                meshes.append(tube((x, y, height + 0.005), (x, y, 0.0), size / 2, frame.material, size / 3))
    return meshes


def _drawers(rng: np.random.Generator, frame: BedFrame, foot: float) -> list[Mesh]:
    count, knob, meshes = int(rng.integers(2, 4)), metal(rng), []
    size = frame.length / count
    for side in (-1.0, 1.0):
        for i in range(count):
            x, y = (i - (count - 1) / 2) * size, side * (frame.width / 2 + 0.015)
            tall = frame.low - foot - 0.06
            meshes.append(block(x, y, foot + 0.04, size * 0.92, 0.014, tall, frame.material))
            meshes.append(block(x, y + side * 0.012, foot + 0.04 + tall * 0.6, 0.14, 0.018, 0.018, knob))
    return meshes


def _canopy(rng: np.random.Generator, frame: BedFrame) -> list[Mesh]:
    top, size = float(rng.uniform(1.9, 2.15)), 0.06
    x, y = frame.length / 2 + 0.02, frame.width / 2 + 0.02
    meshes = [block(sx * x, sy * y, 0.0, size, size, top, frame.material) for sx in (-1, 1) for sy in (-1, 1)]
    meshes += [block(0.0, s * y, top - size, 2 * x, size, size, frame.material) for s in (-1, 1)]
    return meshes + [block(s * x, 0.0, top - size, size, 2 * y, size, frame.material) for s in (-1, 1)]


def _iron(rng: np.random.Generator, frame: BedFrame) -> list[Mesh]:
    """A frame of tubes: arched or square ends with rods and knobs."""
    radius, arch = float(rng.uniform(0.013, 0.024)), float(rng.choice([0.0, 0.12, 0.2, 0.3]))
    head = frame.high + float(rng.uniform(0.3, 0.6))
    foot = frame.high + float(rng.uniform(-0.02, 0.35))
    rods, knobs = int(frame.width / float(rng.uniform(0.09, 0.22))), rng.random() < 0.5
    bed_z, half, meshes = frame.low - 0.03, frame.width / 2 + 0.02, []
    for x, top in ((frame.back - 0.03, head), (frame.length / 2 + 0.04, foot)):
        rise = arch if top > frame.high + 0.1 else 0.3 * arch
        y = np.linspace(-half, half, 15)
        z = top - rise + rise * np.sqrt(np.maximum(1.0 - (y / half) ** 2, 0.0))
        meshes.append(rod(np.column_stack([np.full(15, x), y, z]), radius, frame.material, ends=False))
        for side in (-half, half):
            meshes.append(tube((x, side, 0.0), (x, side, top - rise + radius), radius * 1.2, frame.material))
            if knobs:
                meshes.append(ball((x, side, top - rise + radius), radius * 4, frame.material))
        levels = [bed_z + 0.02] + (
            [frame.high + 0.4 * (top - rise - frame.high)] if top - rise > frame.high + 0.2 else []
        )
        meshes += [tube((x, -half, z), (x, half, z), radius * 0.8, frame.material) for z in levels]
        for at in np.linspace(-half, half, rods + 1)[1:-1]:
            upper = float(np.interp(at, y, z))
            meshes.append(tube((x, at, levels[0]), (x, at, upper), radius * 0.55, frame.material))
    x0, x1 = frame.back - 0.03, frame.length / 2 + 0.04
    meshes += [beam((x0, s * half, bed_z), (x1, s * half, bed_z), (0.045, 0.03), frame.material) for s in (-1, 1)]
    return meshes + [block(0.0, 0.0, frame.low - 0.03, frame.length, frame.width, 0.03, frame.material)]


def _cot(rng: np.random.Generator) -> Mesh:
    """A baby's bed: bars all round, a mattress low or high within."""
    length, width = float(rng.uniform(1.15, 1.4)), float(rng.uniform(0.6, 0.74))
    top, low = float(rng.uniform(0.8, 1.0)), float(rng.uniform(0.25, 0.5))
    material = wood(rng) if rng.random() < 0.6 else plastic(rng)
    frame = BedFrame(length, width, low, low + 0.11, material)
    x, y, bar = length / 2 + 0.02, width / 2 + 0.02, float(rng.uniform(0.012, 0.02))
    foot = 0.12
    meshes = [block(sx * x, sy * y, 0.0, 0.045, 0.045, top, material) for sx in (-1, 1) for sy in (-1, 1)]
    for z in (foot, top - 0.05):
        meshes += [block(0.0, s * y, z, 2 * x, 0.025, 0.05, material) for s in (-1, 1)]
        meshes += [block(s * x, 0.0, z, 0.025, 2 * y, 0.05, material) for s in (-1, 1)]
    for at in np.linspace(-x, x, int(length / 0.085))[1:-1]:
        meshes += [block(float(at), s * y, foot, bar, bar, top - foot - 0.02, material) for s in (-1, 1)]
    if rng.random() < 0.5:
        meshes += [block(s * x, 0.0, foot, 0.02, 2 * y, top - foot, material) for s in (-1, 1)]
    else:
        for at in np.linspace(-y, y, int(width / 0.085))[1:-1]:
            meshes += [block(s * x, float(at), foot, bar, bar, top - foot - 0.02, material) for s in (-1, 1)]
    meshes.append(block(0.0, 0.0, low - 0.02, length, width, 0.02, material))
    meshes.append(cushion((0.0, 0.0, low + 0.055), (length, width, 0.11), linen(rng), 12.0))
    if rng.random() < 0.6:
        meshes += duvet(rng, frame, -0.1 * length, length / 2 - 0.03, (0.0, 0.0), 0.03, fabric(rng))
    meshes.append(cushion((-length / 2 + 0.2, 0.0, low + 0.13), (0.25, 0.38, 0.07), linen(rng), 3.0))
    return joined(meshes)


def _bunk(rng: np.random.Generator, frame: BedFrame) -> Mesh:
    """Two beds, one above the other, with a ladder."""
    upper = BedFrame(frame.length, frame.width, 1.15, 1.15 + frame.high - frame.low, frame.material)
    x, y, top = frame.length / 2 + 0.02, frame.width / 2 + 0.03, 1.65
    meshes = [block(sx * x, sy * y, 0.0, 0.07, 0.07, top, frame.material) for sx in (-1, 1) for sy in (-1, 1)]
    for level in (frame, upper):
        meshes += [block(0.0, s * y, level.low - 0.08, 2 * x, 0.03, 0.14, frame.material) for s in (-1, 1)]
        meshes += [block(s * x, 0.0, level.low - 0.08, 0.03, 2 * y, 0.14, frame.material) for s in (-1, 1)]
        meshes += [block(s * x, 0.0, level.high + 0.15, 0.025, 2 * y, 0.1, frame.material) for s in (-1, 1)]
        meshes.append(block(0.0, 0.0, level.low - 0.02, level.length, level.width, 0.02, frame.material))
        meshes += bedding(rng, level)
    meshes += guard(upper, -1.0) + guard(upper, 1.0)
    at = frame.length / 2 - 0.12
    side = y + 0.04
    meshes += [beam((at - dx, side, 0.0), (at - dx, side, top), (0.03, 0.05), frame.material) for dx in (0.0, 0.35)]
    meshes += [tube((at - 0.35, side, z), (at, side, z), 0.015, frame.material) for z in np.arange(0.25, 1.5, 0.27)]
    return joined(meshes)
