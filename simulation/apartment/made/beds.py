"""Beds: singles, doubles, children's, cots and bunks, made up or half bare."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.made.cut import ball, beam, bent, panel, surface
from edgemap.simulation.apartment.made.shapes import (
    block,
    cushion,
    drawn_colour,
    fabric,
    joined,
    metal,
    plastic,
    tube,
    wood,
)
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part


@dataclass(frozen=True, slots=True)
class _Frame:
    """Metres. length, width: of the mattress, its middle at the origin; low, high: heights of its faces."""

    length: float
    width: float
    low: float
    high: float
    material: Material

    @property
    def back(self) -> float:
        """Where the headboard's front is, x."""
        return -self.length / 2.0 - 0.01


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
    frame = _Frame(length, width, low, high, material)
    if child and rng.random() < 0.2:
        return _bunk(rng, frame)
    if iron:
        meshes = _iron(rng, frame)
    else:
        meshes = _base(rng, frame) + _headboard(rng, frame, padded)
        if rng.random() < (0.7 if child else 0.35):
            meshes += _footboard(rng, frame, padded)
        if child and rng.random() < 0.5:
            meshes += _guard(frame, 1.0) + (_guard(frame, -1.0) if rng.random() < 0.5 else [])
        elif not padded and rng.random() < 0.06:
            meshes += _canopy(rng, frame)
    return joined(meshes + _bedding(rng, frame))


def _base(rng: np.random.Generator, frame: _Frame) -> list[Mesh]:
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


def _feet(rng: np.random.Generator, frame: _Frame, height: float, inset: float) -> list[Mesh]:
    size, style, meshes = float(rng.uniform(0.04, 0.09)), rng.random(), []
    for x in (-frame.length / 2 + inset, frame.length / 2 - inset):
        for y in (-frame.width / 2 + inset, frame.width / 2 - inset):
            if style < 0.5:
                meshes.append(block(x, y, 0.0, size, size, height + 0.005, frame.material))
            else:
                meshes.append(tube((x, y, height + 0.005), (x, y, 0.0), size / 2, frame.material, size / 3))
    return meshes


def _drawers(rng: np.random.Generator, frame: _Frame, foot: float) -> list[Mesh]:
    count, knob, meshes = int(rng.integers(2, 4)), metal(rng), []
    size = frame.length / count
    for side in (-1.0, 1.0):
        for i in range(count):
            x, y = (i - (count - 1) / 2) * size, side * (frame.width / 2 + 0.015)
            tall = frame.low - foot - 0.06
            meshes.append(block(x, y, foot + 0.04, size * 0.92, 0.014, tall, frame.material))
            meshes.append(block(x, y + side * 0.012, foot + 0.04 + tall * 0.6, 0.14, 0.018, 0.018, knob))
    return meshes


def _headboard(rng: np.random.Generator, frame: _Frame, padded: bool) -> list[Mesh]:
    """None, a plain or curved panel, slats, planks, padding, or a shelf."""
    width = frame.width + float(rng.choice([0.0, 0.04, 0.06, 0.3 if rng.random() < 0.2 else 0.04]))
    top = frame.high + float(rng.uniform(0.2, 0.65))
    way = rng.random()
    if padded:
        return _padded(rng, frame, width, top)
    if way < 0.07:
        return []
    if way < 0.5:
        return _board(rng, frame, frame.back, width, top)
    if way < 0.85:
        return _slatted(rng, frame, frame.back - 0.04, width, top)
    deep = float(rng.uniform(0.15, 0.28))
    x = frame.back - deep / 2
    meshes = [block(frame.back - deep + 0.01, 0.0, 0.0, 0.02, width, top, frame.material)]
    meshes += [block(x, s * (width / 2 - 0.01), 0.0, deep, 0.02, top, frame.material) for s in (-1.0, 0.0, 1.0)]
    levels = (top - 0.02, (top + frame.high) / 2, frame.high - 0.05)
    meshes += [block(x, 0.0, z, deep, width, 0.02, frame.material) for z in levels]
    return meshes + [block(frame.back - 0.01, 0.0, 0.0, 0.02, width, frame.high - 0.05, frame.material)]


def _board(rng: np.random.Generator, frame: _Frame, x: float, width: float, top: float) -> list[Mesh]:
    """A panel with a straight, arched, humped or scalloped upper edge, posts and a cap or not."""
    y = np.linspace(-width / 2, width / 2, 33)
    bend, style = 2.0 * y / width, int(rng.integers(6))
    rise = float(rng.uniform(0.08, 0.22))
    curves: tuple[Array, ...] = (
        np.zeros(33),
        np.zeros(33),
        -rise * bend**2,
        -rise * bend**6,
        rise * (np.cos(np.pi * bend) - 1.0) / 2.0,
        -0.18 * rise * (1.0 + np.cos(3.0 * np.pi * bend)) - 0.5 * rise * bend**2,
    )
    thick = float(rng.uniform(0.02, 0.06))
    under = 0.0 if rng.random() < 0.6 else frame.low - 0.05
    meshes = [panel(y, np.full(33, under), top + curves[style], x - thick, thick, frame.material)]
    posts = under > 0.0 or rng.random() < 0.4
    edge = top + float(curves[style][0])
    if posts:
        meshes += _posts(rng, frame, x - thick / 2, width, edge + float(rng.choice([0.0, 0.03, 0.08])))
    if style < 2 and rng.random() < 0.5:
        meshes.append(block(x - thick / 2, 0.0, top, thick + 0.04, width + 0.05, 0.03, frame.material))
    if rng.random() < 0.3:
        for count in range(int(fields := rng.integers(2, 5))):
            at = (count - (fields - 1) / 2) * width / fields
            low = frame.high - 0.1
            tall = max(edge - 0.07 - low, 0.05)
            meshes.append(block(x, at, low, 0.024, width / fields * 0.8, tall, frame.material))
    return meshes


def _posts(rng: np.random.Generator, frame: _Frame, x: float, width: float, top: float) -> list[Mesh]:
    size, style, meshes = float(rng.uniform(0.045, 0.08)), rng.random(), []
    for y in (-width / 2, width / 2):
        if style < 0.6:
            meshes.append(block(x, y, 0.0, size, size, top, frame.material))
        else:
            meshes.append(tube((x, y, 0.0), (x, y, top), size / 2, frame.material))
        if style > 0.4:
            meshes.append(ball((x, y, top + size * 0.3), size * 1.2, frame.material))
    return meshes


def _slatted(rng: np.random.Generator, frame: _Frame, x: float, width: float, top: float) -> list[Mesh]:
    """Posts with bars between them, upright or level; the upper rail straight or arched."""
    meshes = _posts(rng, frame, x, width, top)
    low, thick = frame.low, float(rng.uniform(0.018, 0.03))
    if rng.random() < 0.5:
        count = int(rng.integers(2, 5))
        tall = (top - low) / count
        share = float(rng.uniform(0.45, 0.85))
        return meshes + [
            block(x, 0.0, low + i * tall, thick, width, tall * share, frame.material) for i in range(count)
        ]
    rail = float(rng.uniform(0.05, 0.12))
    y = np.linspace(-width / 2, width / 2, 17)
    rise = float(rng.choice([0.0, 0.0, 0.1])) * (1.0 - (2.0 * y / width) ** 2)
    meshes.append(panel(y, top - rail - 0.02 + rise, top - 0.02 + rise, x - thick / 2, thick, frame.material))
    meshes.append(block(x, 0.0, low, thick, width, rail, frame.material))
    bars = int(width / float(rng.uniform(0.08, 0.2)))
    slim = float(rng.uniform(0.02, 0.06))
    for at in np.linspace(-width / 2, width / 2, bars + 1)[1:-1]:
        meshes.append(block(x, float(at), low, thick * 0.8, slim, top - rail - low, frame.material))
    return meshes


def _padded(rng: np.random.Generator, frame: _Frame, width: float, top: float) -> list[Mesh]:
    """Upholstery: one pad, channels, cushions side by side, a chequer, or wings."""
    thick, way = float(rng.uniform(0.07, 0.16)), rng.random()
    x, low = frame.back - thick / 2, 0.05
    columns, rows = (1, 1) if way < 0.3 else (int(rng.integers(2, 9)), 1) if way < 0.75 else (int(width / 0.2), 3)
    meshes = [block(x - 0.03, 0.0, 0.0, thick - 0.06, width - 0.04, top - 0.02, frame.material)]
    tall = top - low
    across, up = np.linspace(0.0, 1.0, 8 * columns + 1), np.linspace(0.0, 1.0, 8 * rows + 1)

    def bulge(at: Array, count: int) -> Array:
        return np.abs(np.sin(np.pi * at * count)) ** (0.3 if count < 3 else 0.5)

    relief = np.outer(bulge(up, rows), bulge(across, columns))
    # The outermost edge goes right back, so that the pad closes with the board behind it.
    edge = np.outer(np.sin(np.pi * up) > 1e-6, np.sin(np.pi * across) > 1e-6)
    depth = np.where(edge, thick * (0.55 + 0.45 * relief), 0.0)
    points = np.stack(
        np.broadcast_arrays(frame.back - thick + depth, width * (across - 0.5), low + up[:, None] * tall), 2
    )
    meshes.append(Mesh((surface(points, frame.material),)))
    if rng.random() < 0.15:
        meshes += [
            block(x + 0.08, s * (width / 2 + 0.03), 0.0, thick + 0.16, 0.06, top, frame.material) for s in (-1, 1)
        ]
    return meshes


def _footboard(rng: np.random.Generator, frame: _Frame, padded: bool) -> list[Mesh]:
    x, top = frame.length / 2 + 0.07, frame.high + float(rng.uniform(-0.05, 0.25))
    width = frame.width + 0.04
    if padded:
        return [block(x - 0.02, 0.0, 0.03, 0.08, width, max(top - 0.1, frame.low + 0.1), frame.material)]
    return (_slatted if rng.random() < 0.5 else _board)(rng, frame, x, width, top)


def _guard(frame: _Frame, side: float) -> list[Mesh]:
    """A rail along a side of a child's bed, so that nobody falls out."""
    y, top, start = side * (frame.width / 2 + 0.02), frame.high + 0.2, -frame.length / 2
    end = start + frame.length * 0.62
    bars = [block(x, y, frame.low - 0.1, 0.04, 0.022, top - frame.low + 0.1, frame.material) for x in (start, end)]
    return bars + [
        block((start + end) / 2, y, z, end - start, 0.022, 0.06, frame.material) for z in (top - 0.06, top - 0.16)
    ]


def _canopy(rng: np.random.Generator, frame: _Frame) -> list[Mesh]:
    top, size = float(rng.uniform(1.9, 2.15)), 0.06
    x, y = frame.length / 2 + 0.02, frame.width / 2 + 0.02
    meshes = [block(sx * x, sy * y, 0.0, size, size, top, frame.material) for sx in (-1, 1) for sy in (-1, 1)]
    meshes += [block(0.0, s * y, top - size, 2 * x, size, size, frame.material) for s in (-1, 1)]
    return meshes + [block(s * x, 0.0, top - size, size, 2 * y, size, frame.material) for s in (-1, 1)]


def _iron(rng: np.random.Generator, frame: _Frame) -> list[Mesh]:
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
        meshes.append(bent(np.column_stack([np.full(15, x), y, z]), radius, frame.material))
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


def _bedding(rng: np.random.Generator, frame: _Frame) -> list[Mesh]:
    """Mattress, pillows, duvet or blanket drawn up or pulled back, a throw over the foot."""
    sheet = _linen(rng)
    height = frame.high - frame.low
    middle = (0.0, 0.0, frame.low + height / 2)
    meshes = [cushion(middle, (frame.length, frame.width, height), sheet, 14.0)]
    cover = fabric(rng) if rng.random() < 0.7 else _linen(rng)
    half, way = frame.length / 2, rng.random()
    start = -half + float(rng.uniform(0.3, 0.6)) if way < 0.8 else float(rng.uniform(-0.3, 0.3)) * half
    if way < 0.92:
        hang = (float(rng.uniform(0.06, 0.35)), float(rng.uniform(0.02, 0.35)))
        meshes += _duvet(rng, frame, start, half, hang, float(rng.uniform(0.015, 0.06)), cover)
        if way < 0.5:
            fold = _linen(rng)
            meshes += _duvet(
                rng, frame, start - 0.02, start + float(rng.uniform(0.15, 0.35)), (hang[0], 0.0), 0.075, fold
            )
    if way < 0.92 and rng.random() < 0.25:
        at = float(rng.uniform(0.1, 0.6)) * half
        end = min(at + float(rng.uniform(0.3, 0.6)), half - 0.05)
        meshes += _duvet(rng, frame, at, end, (float(rng.uniform(0.2, 0.4)), 0.0), 0.085, fabric(rng))
    return meshes + _pillows(rng, frame, sheet)


def _linen(rng: np.random.Generator) -> Material:
    value = float(rng.uniform(0.5, 0.8))
    if rng.random() < 0.6:
        return Material((value, value * 0.98, value * 0.95))
    return Material(drawn_colour(rng, 0.5))


def _duvet(
    rng: np.random.Generator,
    frame: _Frame,
    start: float,
    end: float,
    hang: tuple[float, float],
    thick: float,
    material: Material,
) -> list[Mesh]:
    """Bedding over the mattress from x start to end; hang: how far it falls at the sides and over the foot, metres."""
    side, foot = (min(drop, frame.high - 0.06) for drop in hang)
    half, round_ = frame.width / 2, 0.05
    a = np.concatenate(
        [
            np.linspace(start, end - round_, 4 + int(8.0 * (end - start))),
            end + np.linspace(-0.02, foot, 6)[: 6 if foot else 1],
        ]
    )
    b = half + np.concatenate([np.linspace(-0.04, 0.02, 3), np.linspace(0.04, max(side, 0.06), 4)])
    b = np.concatenate([-b[::-1], np.linspace(-half + 0.09, half - 0.09, 13), b])
    rows, columns = np.meshgrid(a, b, indexing="ij")
    over_x = np.maximum(rows - end, 0.0) if foot else np.zeros(rows.shape)
    over_y = np.maximum(np.abs(columns) - half, 0.0)
    bumps = noise(rng, 32, 32, slope=1.1)[: len(a), : len(b)] * thick * 0.16
    drop = np.maximum(over_x, over_y)
    away = thick * np.minimum(1.0, drop / 0.03)
    x = np.minimum(rows, end) + np.where(over_x > 0.0, away * (1.0 + 0.5 * bumps / thick), 0.0)
    y = np.sign(columns) * (np.minimum(np.abs(columns), half) + np.where(over_y > 0.0, away + bumps * 0.5, 0.0))
    z = frame.high + thick * (1.0 - np.minimum(1.0, drop / 0.03) * 0.6) + bumps - drop
    top = np.stack([x, y, np.maximum(z, 0.02)], axis=2)
    # Its edges are as thick as it is: the head end turns under.
    lip = top[:1].copy()
    lip[..., 2] -= thick * 1.1
    hem = surface(np.concatenate([lip, top[:1]]), material)
    parts = [hem, surface(top, material)]
    if not foot:
        last = top[-1:].copy()
        last[..., 2] -= thick * 1.1
        parts.append(surface(np.concatenate([top[-1:], last]), material))
    parts = [Part(material, part.positions[:, ::-1], -part.normals[:, ::-1], part.uv[:, ::-1]) for part in parts]
    return [Mesh(tuple(parts))]


def _pillows(rng: np.random.Generator, frame: _Frame, sheet: Material) -> list[Mesh]:
    """One or two across, perhaps more in front; flat, or leaning against the head."""
    across = 2 if frame.width > 1.3 else 1
    cloth = sheet if rng.random() < 0.4 else _linen(rng) if rng.random() < 0.6 else fabric(rng)
    wide = min(frame.width / across * 0.92, float(rng.uniform(0.5, 0.8)))
    deep, thick = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.1, 0.17))
    meshes, lean = [], float(rng.uniform(0.05, 0.3)) if rng.random() < 0.6 else float(rng.uniform(0.7, 1.1))
    places = [(0.0, cloth, 1.0)]
    if rng.random() < 0.3:
        places.append((0.2, fabric(rng), float(rng.uniform(0.6, 0.9))))
    for ahead, material, scale in places:
        for i in range(across):
            y = (i - (across - 1) / 2) * frame.width / across + float(rng.normal(0.0, 0.015))
            size = np.array([deep, wide, thick]) * scale
            angle = lean + float(rng.normal(0.0, 0.04)) + (0.2 if ahead else 0.0)
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
            half_x, half_z = (c * size[0] + s * size[2]) / 2, (s * size[0] + c * size[2]) / 2
            shift = np.array([-frame.length / 2 + 0.01 + half_x + ahead, y, frame.high + half_z * 0.9])
            (part,) = cushion((0.0, 0.0, 0.0), size, material, 2.8).parts
            meshes.append(Mesh((part.moved(turn, shift),)))
    return meshes


def _cot(rng: np.random.Generator) -> Mesh:
    """A baby's bed: bars all round, a mattress low or high within."""
    length, width = float(rng.uniform(1.15, 1.4)), float(rng.uniform(0.6, 0.74))
    top, low = float(rng.uniform(0.8, 1.0)), float(rng.uniform(0.25, 0.5))
    material = wood(rng) if rng.random() < 0.6 else plastic(rng)
    frame = _Frame(length, width, low, low + 0.11, material)
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
    meshes.append(cushion((0.0, 0.0, low + 0.055), (length, width, 0.11), _linen(rng), 12.0))
    if rng.random() < 0.6:
        meshes += _duvet(rng, frame, -0.1 * length, length / 2 - 0.03, (0.0, 0.0), 0.03, fabric(rng))
    meshes.append(cushion((-length / 2 + 0.2, 0.0, low + 0.13), (0.25, 0.38, 0.07), _linen(rng), 3.0))
    return joined(meshes)


def _bunk(rng: np.random.Generator, frame: _Frame) -> Mesh:
    """Two beds, one above the other, with a ladder."""
    upper = _Frame(frame.length, frame.width, 1.15, 1.15 + frame.high - frame.low, frame.material)
    x, y, top = frame.length / 2 + 0.02, frame.width / 2 + 0.03, 1.65
    meshes = [block(sx * x, sy * y, 0.0, 0.07, 0.07, top, frame.material) for sx in (-1, 1) for sy in (-1, 1)]
    for level in (frame, upper):
        meshes += [block(0.0, s * y, level.low - 0.08, 2 * x, 0.03, 0.14, frame.material) for s in (-1, 1)]
        meshes += [block(s * x, 0.0, level.low - 0.08, 0.03, 2 * y, 0.14, frame.material) for s in (-1, 1)]
        meshes += [block(s * x, 0.0, level.high + 0.15, 0.025, 2 * y, 0.1, frame.material) for s in (-1, 1)]
        meshes.append(block(0.0, 0.0, level.low - 0.02, level.length, level.width, 0.02, frame.material))
        meshes += _bedding(rng, level)
    meshes += _guard(upper, -1.0) + _guard(upper, 1.0)
    at = frame.length / 2 - 0.12
    side = y + 0.04
    meshes += [beam((at - dx, side, 0.0), (at - dx, side, top), (0.05, 0.03), frame.material) for dx in (0.0, 0.35)]
    meshes += [tube((at - 0.35, side, z), (at, side, z), 0.015, frame.material) for z in np.arange(0.25, 1.5, 0.27)]
    return joined(meshes)
