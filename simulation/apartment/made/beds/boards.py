"""Headboards, footboards and guard rails of beds."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.beds.bedding import BedFrame
from edgemap.simulation.apartment.made.shapes.bars import tube
from edgemap.simulation.apartment.made.shapes.grids import surface
from edgemap.simulation.apartment.made.shapes.lofts import sheet
from edgemap.simulation.apartment.made.shapes.solids import ball, block
from edgemap.simulation.render.mesh import Array, Material, Mesh


def headboard(rng: np.random.Generator, frame: BedFrame, padded: bool) -> list[Mesh]:
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


def _board(rng: np.random.Generator, frame: BedFrame, x: float, width: float, top: float) -> list[Mesh]:
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
    meshes = [_panel(y, np.full(33, under), top + curves[style], x - thick / 2, thick, frame.material)]
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


def _panel(along: Array, low: Array, high: Array, x: float, thick: float, material: Material) -> Mesh:
    """Upright about x: at each place (N,) of `along` it reaches from low to high."""
    return sheet(np.stack([np.column_stack([np.full(along.shape, x), along, z]) for z in (low, high)]), thick, material)


def _posts(rng: np.random.Generator, frame: BedFrame, x: float, width: float, top: float) -> list[Mesh]:
    size, style, meshes = float(rng.uniform(0.045, 0.08)), rng.random(), []
    for y in (-width / 2, width / 2):
        if style < 0.6:
            meshes.append(block(x, y, 0.0, size, size, top, frame.material))
        else:
            meshes.append(tube((x, y, 0.0), (x, y, top), size / 2, frame.material))
        if style > 0.4:
            meshes.append(ball((x, y, top + size * 0.3), size * 1.2, frame.material))
    return meshes


def _slatted(rng: np.random.Generator, frame: BedFrame, x: float, width: float, top: float) -> list[Mesh]:
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
    meshes.append(_panel(y, top - rail - 0.02 + rise, top - 0.02 + rise, x, thick, frame.material))
    meshes.append(block(x, 0.0, low, thick, width, rail, frame.material))
    bars = int(width / float(rng.uniform(0.08, 0.2)))
    slim = float(rng.uniform(0.02, 0.06))
    for at in np.linspace(-width / 2, width / 2, bars + 1)[1:-1]:
        meshes.append(block(x, float(at), low, thick * 0.8, slim, top - rail - low, frame.material))
    return meshes


def _padded(rng: np.random.Generator, frame: BedFrame, width: float, top: float) -> list[Mesh]:
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


def footboard(rng: np.random.Generator, frame: BedFrame, padded: bool) -> list[Mesh]:
    """Lower than the head: a pad, slats or a board."""
    x, top = frame.length / 2 + 0.07, frame.high + float(rng.uniform(-0.05, 0.25))
    width = frame.width + 0.04
    if padded:
        return [block(x - 0.02, 0.0, 0.03, 0.08, width, max(top - 0.1, frame.low + 0.1), frame.material)]
    return (_slatted if rng.random() < 0.5 else _board)(rng, frame, x, width, top)


def guard(frame: BedFrame, side: float) -> list[Mesh]:
    """A rail along a side of a child's bed, so that nobody falls out."""
    y, top, start = side * (frame.width / 2 + 0.02), frame.high + 0.2, -frame.length / 2
    end = start + frame.length * 0.62
    bars = [block(x, y, frame.low - 0.1, 0.04, 0.022, top - frame.low + 0.1, frame.material) for x in (start, end)]
    return bars + [
        block((start + end) / 2, y, z, end - start, 0.022, 0.06, frame.material) for z in (top - 0.06, top - 0.16)
    ]
