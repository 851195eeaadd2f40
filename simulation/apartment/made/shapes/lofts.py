"""Smooth surfaces through grids and rings: outlines, lofts, bodies of revolution, sheets."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.render.mesh import Array, Material, Mesh, Part


def grid(points: Array, normals: Array, material: Material) -> Part:
    """A smooth surface through a grid of points (R, C, 3) with normals of any length (R, C, 3).

    It faces outwards if its columns run counter-clockwise, viewed from the last row.
    """
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.maximum(length, 1e-9)
    rows, columns = np.meshgrid(np.linspace(0, 1, points.shape[0]), np.linspace(0, 1, points.shape[1]), indexing="ij")
    uv = np.stack([columns, rows], axis=2)
    corners, shading, coordinates = (triangles(values) for values in (points, normals, uv))
    solid = np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).swapaxes(0, 1)), axis=1) > 1e-12
    return Part(material, corners[solid], shading[solid], coordinates[solid])


def surface(points: Array, material: Material, round_: bool = False, looped: bool = False) -> Part:
    """A smooth surface through a grid of points (R, C, 3). It faces in the direction of the cross product of columns
    and rows. `normals_of` computes its normals and explains round_ and looped."""
    return grid(points, normals_of(points, round_, looped), material)


def normals_of(points: Array, round_: bool = False, looped: bool = False) -> Array:
    """Unit normals (R, C, 3) of a grid, in the direction of the cross product of columns and rows.

    A normal is the mean of the normals of the adjacent cells, weighted by area. round_: the last column repeats the
    first one. looped: the last row repeats the first one.
    """
    wrapped = points
    if looped:
        wrapped = np.concatenate([wrapped[-2:-1], wrapped, wrapped[1:2]])
    if round_:
        wrapped = np.concatenate([wrapped[:, -2:-1], wrapped, wrapped[:, 1:2]], axis=1)
    cells = np.cross(wrapped[1:, 1:] - wrapped[:-1, :-1], wrapped[1:, :-1] - wrapped[:-1, 1:])
    total = np.zeros_like(wrapped)
    for rows in (np.s_[:-1], np.s_[1:]):
        for columns in (np.s_[:-1], np.s_[1:]):
            total[rows, columns] += cells
    total = total[1:-1] if looped else total
    total = total[:, 1:-1] if round_ else total
    # If folds leave a point without a direction, it takes the direction of the complete surface.
    length = np.linalg.norm(total, axis=2, keepdims=True)
    total = np.where(length > 1e-14, total / np.maximum(length, 1e-14), total.sum(axis=(0, 1)))
    return total / np.maximum(np.linalg.norm(total, axis=2, keepdims=True), 1e-12)


def triangles(values: Array) -> Array:
    """Splits each cell of grids (..., R, C, D) into two counter-clockwise triangles: (2 * cells, 3, D)."""
    low, high = values[..., :-1, :, :], values[..., 1:, :, :]
    sides = (low[..., :-1, :], low[..., 1:, :], high[..., 1:, :], high[..., :-1, :])
    a, b, c, d = (part.reshape(-1, values.shape[-1]) for part in sides)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def rectangle(depth: float, width: float, radius: float, steps: int = 4) -> Array:
    """Closed outline (N, 2) of a rectangle centred at the origin. radius: of its corners."""
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])
    radius = max(min(radius, depth / 2.0 - 1e-4, width / 2.0 - 1e-4), 1e-4)
    turn = np.linspace(0.0, np.pi / 2.0, steps)
    arcs = []
    for quarter, corner in enumerate(np.roll(corners, -1, axis=0)):
        angle = turn + quarter * np.pi / 2.0
        middle = corner * [depth / 2.0 - radius, width / 2.0 - radius]
        arcs.append(middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return _closed(np.concatenate(arcs))


def oval(
    depth: float,
    width: float,
    squareness: float = 2.0,
    behind: float | None = None,
    width_behind: float | None = None,
    points: int = 32,
) -> Array:
    """Closed superellipse (points + 1, 2) centred at the origin.

    squareness: 2 gives an ellipse, 20 a rectangle with soft corners. behind: squareness of the half with negative x, if
    it differs. width_behind: width at the end with negative x, if it differs.
    """
    turn = np.arange(points) * 2.0 * np.pi / points
    c, s = np.cos(turn), np.sin(turn)
    power = 2.0 / np.where(c >= 0.0, squareness, squareness if behind is None else behind)
    x, y = (np.sign(wave) * np.abs(wave) ** power for wave in (c, s))
    rear = width if width_behind is None else width_behind
    return _closed(np.stack([x * depth / 2.0, y * (rear + (width - rear) * (x + 1.0) / 2.0) / 2.0], axis=1))


def raised(outline: Array, x: float, y: float, z: float, scale: float = 1.0) -> Array:
    """Scales an outline (N, 2) and moves it to (x, y, z), as a level ring (N, 3)."""
    return np.concatenate([outline * scale + [x, y], np.full((len(outline), 1), z)], axis=1)


def _closed(outline: Array) -> Array:
    return np.concatenate([outline, outline[:1]])


def loft(rings: ArrayLike, material: Material, low: bool = True, high: bool = True) -> Mesh:
    """A smooth surface through closed rings (R, N, 3). low, high: whether a flat face closes the first and last ring.

    It faces outwards if the rings run counter-clockwise, viewed from the last ring.
    """
    rings = np.asarray(rings, dtype=np.float64)
    ends = ([rings[0, ::-1]] if low else []) + ([rings[-1]] if high else [])
    return [surface(rings, material, round_=True), *(cap(ring, material) for ring in ends)]


def cap(ring: Array, material: Material) -> Part:
    """A flat face that fills a closed, star-shaped ring (N, 3). It faces the side where the ring is counter-clockwise.

    Its texture repeats every metre.
    """
    middle = (ring.min(axis=0) + ring.max(axis=0)) / 2.0
    out = ring - middle
    facing = np.cross(out[:-1], out[1:])
    corners = np.stack([np.broadcast_to(middle, facing.shape), ring[:-1], ring[1:]], axis=1)
    corners = corners[np.linalg.norm(facing, axis=1) > 1e-12]
    facing = facing.sum(axis=0) / np.linalg.norm(facing.sum(axis=0))
    flat = np.delete(corners, np.argmax(np.abs(facing)), axis=2)
    return Part(material, corners, np.broadcast_to(facing, corners.shape).copy(), flat)


def lathe(radii: Array, heights: Array, material: Material, sides: int = 28) -> Part:
    """A smooth surface of revolution. radii, heights: profile, (N,) each. It faces outwards where heights increase."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def turned(out: Array, up: Array) -> Array:
        return np.concatenate([out[:, None, None] * around, np.tile(up[:, None, None], (1, sides + 1, 1))], axis=2)

    points, normals = turned(radii, heights), turned(np.gradient(heights), -np.gradient(radii))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return grid(points, normals, material)


def sheet(middle: Array, thickness: float | Array, material: Material, behind: Material | None = None) -> Mesh:
    """A bent sheet with a middle surface (R, C, 3). Its front faces the cross product of columns and rows.

    thickness: one value, or (R, C), one for each point, for padding. behind: material of the back, if it differs.
    """
    half = np.broadcast_to(np.asarray(thickness, dtype=np.float64), middle.shape[:2])[..., None] / 2.0
    facing = normals_of(middle)
    front, back = middle + half * facing, middle - half * facing
    sides = (np.s_[0], np.s_[:, -1], np.s_[-1, ::-1], np.s_[::-1, 0])
    rims = [surface(np.stack([back[side], front[side]]), behind or material) for side in sides]
    return [surface(front, material), surface(back[:, ::-1], behind or material), *rims]
