"""Bodies with rounded edges and bent bars, put together from rings of points.

All in metres, x out of a piece's front, y left, z up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes import grid
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part

# Columns of a ring's plane for a body that goes along x, y or z, so that it goes round counter-clockwise.
_PLANES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))


def rectangle(depth: float, width: float, radius: float, steps: int = 4) -> Array:
    """A closed outline (N, 2) about 0, counter-clockwise: a rectangle with round corners."""
    radius = max(min(radius, depth / 2.0 - 1e-4, width / 2.0 - 1e-4), 1e-4)
    turn = np.linspace(0.0, np.pi / 2.0, steps)
    corners = []
    for quarter, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = turn + quarter * np.pi / 2.0
        middle = np.array([x * (depth / 2.0 - radius), y * (width / 2.0 - radius)])
        corners.append(middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return _closed(np.concatenate(corners))


def oval(depth: float, width: float, back: float = 2.0, front: float = 2.0, points: int = 32) -> Array:
    """A closed outline (N, 2) about 0, counter-clockwise: 2 is an ellipse's half, more is squarer."""
    turn = np.arange(points) * 2.0 * np.pi / points
    c, s = np.cos(turn), np.sin(turn)
    power = 2.0 / np.where(c >= 0.0, front, back)
    x, y = (np.sign(v) * np.abs(v) ** power for v in (c, s))
    return _closed(np.stack([x * depth / 2.0, y * width / 2.0], axis=1))


def _closed(outline: Array) -> Array:
    return np.concatenate([outline, outline[:1]])


def at(outline: Array, x: float, y: float, z: float, scale: float = 1.0) -> Array:
    """An outline (N, 2) as a level ring (N, 3) about a point."""
    return np.concatenate([outline * scale + [x, y], np.full((len(outline), 1), z)], axis=1)


def loft(rings: ArrayLike, material: Material, low: bool = True, high: bool = True) -> Mesh:
    """A surface through closed rings (R, N, 3), smooth all over, with flat ends or without.

    It faces outwards where the rings go round counter-clockwise, seen from the end that they go to.
    """
    rings = np.asarray(rings, dtype=np.float64)
    open_ = rings[:, :-1]
    round_ = np.roll(open_, -1, axis=1) - np.roll(open_, 1, axis=1)
    normals = np.cross(round_, np.gradient(open_, axis=0))
    parts = [grid(rings, np.concatenate([normals, normals[:, :1]], axis=1), material)]
    if low:
        parts.append(_end(rings[0, ::-1], material))
    if high:
        parts.append(_end(rings[-1], material))
    return Mesh(tuple(parts))


def _end(ring: Array, material: Material) -> Part:
    """A flat face within a closed convex ring (N, 3), in strips from one half of it to the other."""
    half = (len(ring) - 1) // 2
    there, back = ring[: half + 1], ring[: -half - 2 : -1]
    facing = np.cross(ring[:-1] - ring[:-1].mean(axis=0), ring[1:] - ring[:-1].mean(axis=0)).sum(axis=0)
    part = grid(np.stack([there, back]), np.broadcast_to(facing, (2, half + 1, 3)), material)
    low, size = ring.min(axis=0), np.ptp(ring, axis=0)
    first, second = np.sort(np.argsort(size)[1:])
    flat = (part.positions - low) / max(float(size.max()), 1e-9)
    return replace(part, uv=flat[..., [first, second]])


def rounded(low: ArrayLike, high: ArrayLike, material: Material, radius: float, edge: float, axis: int = 2) -> Mesh:
    """A box between two corners: edges along an axis are round by a radius, those of the two ends by `edge`."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    size, middle = high - low, (low + high) / 2.0
    first, second, along = _PLANES[axis]
    edge = min(edge, size.min() / 2.0 - 1e-4)
    turn = np.linspace(0.0, np.pi / 2.0, 4)
    insets = edge * (1.0 - np.sin(turn))
    rises = edge * (1.0 - np.cos(turn))
    rings = []
    for inset, height in [
        *zip(insets, rises, strict=True),
        *zip(insets[::-1], (size[along] - rises)[::-1], strict=True),
    ]:
        flat = rectangle(size[first] - 2.0 * inset, size[second] - 2.0 * inset, radius - inset)
        ring = np.empty((len(flat), 3))
        ring[:, first], ring[:, second] = flat[:, 0] + middle[first], flat[:, 1] + middle[second]
        ring[:, along] = low[along] + height
        rings.append(ring)
    return loft(rings, material)


def pipe(points: ArrayLike, radius: float, across: ArrayLike, material: Material, wide: float | None = None) -> Mesh:
    """A bar along points (P, 3) of a plane that `across` (3,) stands upright on; wide: its half width along `across`,
    for straps."""
    points, across = np.asarray(points, dtype=np.float64), np.asarray(across, dtype=np.float64)
    across = across / np.linalg.norm(across)
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    other = np.cross(tangents, across)
    turn = np.linspace(0.0, 2.0 * np.pi, 9)
    c, s = np.cos(turn)[None, :, None], np.sin(turn)[None, :, None]
    width = radius if wide is None else wide
    rings = points[:, None] + c * width * across + s * radius * other[:, None]
    return loft(rings, material)


def arc(start: ArrayLike, end: ArrayLike, bulge: ArrayLike, points: int = 9) -> Array:
    """Points (P, 3) from start to end along half an ellipse that reaches out by `bulge` (3,)."""
    start, end, bulge = (np.asarray(value, dtype=np.float64) for value in (start, end, bulge))
    turn = np.linspace(0.0, np.pi, points)[:, None]
    return (start + end) / 2.0 - np.cos(turn) * (end - start) / 2.0 + np.sin(turn) * bulge
