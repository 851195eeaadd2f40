"""Bars: square-edged beams, straight tubes, rods along any path."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes.grids import surface
from edgemap.simulation.apartment.made.shapes.lofts import loft
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, quad


def beam(
    start: ArrayLike,
    end: ArrayLike,
    size: tuple[float, float],
    material: Material,
    taper: float = 1.0,
    across: ArrayLike = (0.0, 1.0, 0.0),
    level: bool = False,
) -> Mesh:
    """A square-edged bar between two points (3,).

    size: along `across`, and square to that and to the bar. taper: of the end's section against the start's. level:
    the ends of a slanting bar are cut level.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = _unit(end - start)
    side = _unit(np.asarray(across) - (np.asarray(across) @ axis) * axis)
    ring = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2.0 * size @ np.stack([side, np.cross(axis, side)])
    if level:
        ring = ring - axis * (ring[:, 2:] / axis[2])
    low, high = start + ring, end + taper * ring
    length = float(np.linalg.norm(end - start))
    sides = [np.stack([low[i], low[i - 3], high[i - 3], high[i]]) for i in range(4)]
    parts = [_facet(corners, (length, size[i % 2]), material) for i, corners in enumerate(sides)]
    return Mesh((*parts, _facet(high, size, material), _facet(low[::-1], size, material)))


def _facet(corners: Array, size: tuple[float, float], material: Material) -> Part:
    """A flat four-cornered face (4, 3), counter-clockwise; wood's grain runs along its second edge."""
    u, v = size
    face = quad(corners[0], corners[1] - corners[0], corners[3] - corners[0], material)
    order = np.array([[0, 1, 2], [0, 2, 3]])
    coordinates = np.array([[0.0, 0.0], [0.0, v], [u, v], [u, 0.0]])
    return Part(material, corners[order], face.normals, coordinates[order])


def tube(start: ArrayLike, end: ArrayLike, radius: float, material: Material, end_radius: float | None = None) -> Mesh:
    """A straight round bar between two points (3,), closed; end_radius: where it tapers."""
    path = np.array([start, end], dtype=np.float64)
    axis = _unit(path[1] - path[0])
    across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.7 else [0.0, 1.0, 0.0])
    return rod(path, [radius, radius if end_radius is None else end_radius], material, sides=10, across=across)


def bar(start: ArrayLike, end: ArrayLike, radius: float, material: Material, hidden_m: float) -> Mesh:
    """A straight round bar whose ends are let into other parts: light is kept at corners, so it has some outside."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    share = min(hidden_m / float(np.linalg.norm(end - start)), 0.45)
    at = np.array([0.0, share, 1.0 - share, 1.0])[:, None]
    return rod(start + at * (end - start), radius, material)


def rod(
    path: ArrayLike,
    radius: ArrayLike,
    material: Material,
    flat: float = 1.0,
    sides: int = 8,
    across: ArrayLike | None = None,
    closed: bool = False,
    ends: bool = True,
) -> Mesh:
    """A round bar along a path (N, 3), bent or turned: one radius, or one for every point.

    flat: of its section's height against its width, for ovals and straps. across (3,): where the width lies, as nearly
    as the path lets it; otherwise it turns as little as can be. closed: the path ends where it starts. ends: whether
    they are shut.
    """
    path = np.asarray(path, dtype=np.float64)
    ahead = np.concatenate([path[-2:-1], path, path[1:2]]) if closed else path
    along = _unit(np.gradient(ahead, axis=0)[1:-1] if closed else np.gradient(ahead, axis=0))
    side = np.eye(3)[int(np.argmin(np.ptp(path, axis=0) + 0.1 * np.abs(along[0])))]
    wide = []
    for direction in along:
        side = side if across is None else np.asarray(across, dtype=np.float64)
        side = _unit(side - (side @ direction) * direction)
        wide.append(side)
    wide = np.array(wide)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)[:, None]
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(path))[:, None, None]
    rings = path[:, None] + radii * (np.cos(turn) * wide + flat * np.sin(turn) * np.cross(along[:, None], wide))
    if closed:
        return Mesh((surface(rings, material, round_=True, looped=True),))
    return loft(rings, material, low=ends, high=ends)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
