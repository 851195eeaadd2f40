"""What seats are put together from besides boxes and tubes: bars, bent rods, bent sheets, boards and upholstery.

All in metres, x out of a piece's front, y left, z up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes import grid
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, quad


def beam(
    start: ArrayLike,
    end: ArrayLike,
    size: tuple[float, float],
    material: Material,
    taper: float = 1.0,
    across: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> Mesh:
    """A square-edged bar between two points (3,).

    size: along `across`, and square to that and to the bar. taper: of the end's section against the start's.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = _unit(end - start)
    side = _unit(np.asarray(across) - (np.asarray(across) @ axis) * axis)
    ring = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2.0 * size @ np.stack([side, np.cross(axis, side)])
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


def rod(
    path: Array,
    radius: float | Array,
    material: Material,
    flat: float = 1.0,
    sides: int = 8,
    closed: bool = False,
) -> Mesh:
    """A round bar along a path (N, 3), bent or turned: one radius, or one for every point.

    flat: of its section's height against its width, where it is an oval. closed: it ends where it starts.
    """
    path = np.asarray(path, dtype=np.float64)
    along = _unit(np.gradient(np.concatenate([path[-2:-1], path, path[1:2]]), axis=0)[1:-1] if closed else _steps(path))
    spread = np.ptp(path, axis=0)
    side = np.eye(3)[int(np.argmin(spread + 0.1 * np.abs(along[0])))]
    frames = []
    for direction in along:
        side = _unit(side - (side @ direction) * direction)
        frames.append((side, np.cross(direction, side)))
    wide, high = np.array(frames).swapaxes(0, 1)[:, :, None]
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)[:, None]
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(path))[:, None, None]
    rim = radii * (np.cos(turn) * wide + flat * np.sin(turn) * high)
    parts = [grid(path[:, None] + rim, np.cos(turn) * wide + np.sin(turn) / flat * high, material)]
    for at, facing, order in () if closed else ((0, -along[0], 1), (-1, along[-1], -1)):
        cap = (path[at] + np.stack([0.0 * rim[at], rim[at]]))[::order]
        parts.append(grid(cap, np.broadcast_to(facing, cap.shape), material))
    return Mesh(tuple(parts))


def bar(start: ArrayLike, end: ArrayLike, radius: float, material: Material, hidden_m: float) -> Mesh:
    """A straight round bar whose ends are let into other parts: light is kept at corners, so it has some outside."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    share = min(hidden_m / float(np.linalg.norm(end - start)), 0.45)
    at = np.array([0.0, share, 1.0 - share, 1.0])[:, None]
    return rod(start + at * (end - start), radius, material)


def filleted(corners: ArrayLike, radius: float, steps: int = 5, closed: bool = False) -> Array:
    """A path (N, 3) through straight runs whose corners are rounded."""
    corners = np.asarray(corners, dtype=np.float64)
    if closed:
        corners = np.concatenate([[(corners[0] + corners[-1]) / 2.0], corners, [(corners[0] + corners[-1]) / 2.0]])
    path, t = [corners[:1]], np.linspace(0.0, 1.0, steps)[:, None]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        ends = []
        for other in (before, after):
            reach = min(radius, 0.48 * float(np.linalg.norm(other - corner)))
            ends.append(corner + reach * _unit(other - corner))
        path.append((1.0 - t) ** 2 * ends[0] + 2.0 * t * (1.0 - t) * corner + t**2 * ends[1])
    return np.concatenate([*path, corners[-1:]])


def sheet(surface: Array, thickness: float | Array, material: Material, behind: Material | None = None) -> Mesh:
    """A bent sheet about a surface (R, C, 3), whose front has rows to its left-hand way of columns (columns x rows).

    thickness: one, or one at every point (R, C), for padding. behind: material of the back, where it is another.
    """
    half = np.broadcast_to(np.asarray(thickness, dtype=np.float64), surface.shape[:2])[..., None] / 2.0
    facing = _facing(surface)
    front, back = surface + half * facing, surface - half * facing
    sides = (np.s_[0], np.s_[:, -1], np.s_[-1, ::-1], np.s_[::-1, 0])
    rims = [np.stack([back[side], front[side]]) for side in sides]
    reverse = back[:, ::-1]
    return Mesh(
        (
            grid(front, _facing(front), material),
            grid(reverse, _facing(reverse), behind or material),
            *(grid(rim, _facing(rim), behind or material) for rim in rims),
        )
    )


def outline(depth: float, front: float, back: float, squareness: float = 5.0, points: int = 32) -> Array:
    """A seat's outline (N, 2), closed, counter-clockwise, of a width in front and one behind; squareness 2 is an
    ellipse."""
    turn = np.linspace(0.0, 2.0 * np.pi, points + 1)
    x, y = (np.sign(wave) * np.abs(wave) ** (2.0 / squareness) for wave in (np.cos(turn), np.sin(turn)))
    return np.stack([x * depth / 2.0, y * (back + (front - back) * (x + 1.0) / 2.0) / 2.0], axis=1)


def board(shape: Array, low: float, high: float, material: Material) -> Mesh:
    """A flat board of an outline (N, 2) between two heights."""
    levels = [(0.0, low), (1.0, low), (1.0, high), (0.0, high)]
    return Mesh(tuple(_loft(shape, levels[i : i + 2], material) for i in range(3)))


def pad(shape: Array, low: float, high: float, material: Material, crown: float = 0.015) -> Mesh:
    """A seat's padding of an outline (N, 2) between two heights, its edges round, its top domed by a crown."""
    edge = min(0.4 * (high - low), 0.03) / float(np.abs(shape).max())
    soft = [(1.0 - edge, low), (1.0, low * 0.7 + high * 0.3), (1.0, low * 0.3 + high * 0.7), (1.0 - 0.4 * edge, high)]
    top = [(1.0 - 1.5 * edge, high + 0.35 * crown), (0.6, high + 0.85 * crown), (0.0, high + crown)]
    return Mesh((_loft(shape, [(0.0, low), (1.0 - edge, low)], material), _loft(shape, soft + top, material)))


def _loft(shape: Array, levels: list[tuple[float, float]], material: Material) -> Part:
    """A surface through one outline at several (scale, height), from below to above."""
    scale, height = np.array(levels).T[:, :, None]
    around = np.gradient(np.concatenate([shape[-2:-1], shape, shape[1:2]]), axis=0)[1:-1]
    out = _unit(np.stack([around[:, 1], -around[:, 0]], axis=1))
    rows = np.broadcast_to(height, (len(levels), len(shape)))
    points = np.concatenate([scale[..., None] * shape, rows[..., None]], axis=2)
    rise, spread = np.gradient(height[:, 0]), np.gradient(scale[:, 0])
    flat = -spread[:, None] * (shape * out).sum(axis=1)
    return grid(points, np.concatenate([rise[:, None, None] * out, flat[..., None]], axis=2), material)


def padded(middle: ArrayLike, size: ArrayLike, material: Material, radius: float = 0.05, swell: float = 0.1) -> Mesh:
    """An upholstered block about a middle (3,) with sides (3,): edges rounded by a radius, its faces swelling by this
    share of their distance from the middle."""
    half = np.asarray(size, dtype=np.float64) / 2.0
    radius = min(radius, 0.9 * float(half.min()))
    inner = half - radius
    ring, signs = [], ((1, 1), (-1, 1), (-1, -1), (1, -1))
    for corner, sign in enumerate(signs):
        for turn in np.pi / 2.0 * (corner + np.array([0.0, 0.5, 1.0])):
            ring.append((*(inner[:2] * sign), np.cos(turn), np.sin(turn)))
        ring.append((*(half[:2] * ((0, 1), (-1, 0), (0, -1), (1, 0))[corner]), 0.0, 0.0))
    ring = np.array([*ring, ring[0]])
    rows = [
        (0.0, 0.0, -1.0, -1),
        (0.55, 0.0, -1.0, -1),
        (1.0, 0.0, -1.0, -1),
        (1.0, 0.7, -0.7, -1),
        (1.0, 1.0, 0.0, -1),
    ]
    rows += [(1.0, 1.0, 0.0, 0)] + [(share, bend, -up, 1) for share, bend, up, _ in rows[::-1]]
    if not swell:
        ring = ring[np.arange(len(ring)) % 4 != 3]
        rows = [row for row in rows if row[0] != 0.55 and row[3]]
    middles = np.hypot(ring[:, 2], ring[:, 3]) < 0.5
    points = []
    for share, bend, up, level in rows:
        flat = ring[:, :2] - np.where(middles[:, None], np.sign(ring[:, :2]) * radius * (1.0 - bend), 0.0)
        flat = share * (flat + radius * bend * ring[:, 2:])
        points.append(np.column_stack([flat, np.full(len(ring), level * inner[2] + up * radius)]))
    points = np.array(points)
    share = points / half
    room = 1.0 - share**2
    others = np.stack([room[..., 1] * room[..., 2], room[..., 0] * room[..., 2], room[..., 0] * room[..., 1]], axis=2)
    points = points + swell * points * others
    wrapped = np.concatenate([points[:, -2:-1], points, points[:, 1:2]], axis=1)
    normals = _facing(wrapped)[:, 1:-1]
    normals[0], normals[-1] = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    return Mesh((grid(np.asarray(middle) + points, normals, material),))


def leaned(mesh: Mesh, angle_rad: float, about: ArrayLike) -> Mesh:
    """The mesh leaned backwards about a line across through a point (3,)."""
    return turned(mesh, 1, -angle_rad, about)


def turned(mesh: Mesh, axis: int, angle_rad: float, about: ArrayLike) -> Mesh:
    """The mesh turned about x, y or z (0 to 2) through a point (3,)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    rotation, (one, other) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    rotation[one, one] = rotation[other, other] = c
    rotation[one, other], rotation[other, one] = -s, s
    about = np.asarray(about, dtype=np.float64)
    return Mesh(tuple(part.moved(rotation, about - rotation @ about) for part in mesh.parts))


def _facing(surface: Array) -> Array:
    """Normals (R, C, 3) of a grid, from the cells about each point by their size."""
    cells = np.cross(surface[1:, 1:] - surface[:-1, :-1], surface[1:, :-1] - surface[:-1, 1:])
    total = np.zeros_like(surface)
    for rows in (np.s_[:-1], np.s_[1:]):
        for columns in (np.s_[:-1], np.s_[1:]):
            total[rows, columns] += cells
    return _unit(total)


def _steps(path: Array) -> Array:
    return np.gradient(path, axis=0)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
