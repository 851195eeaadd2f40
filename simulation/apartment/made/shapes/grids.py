"""Smooth surfaces through grids of points, for bent, turned and lofted shapes."""

import numpy as np

from edgemap.simulation.render.mesh import Array, Material, Part


def grid(points: Array, normals: Array, material: Material) -> Part:
    """A smooth surface through a grid of points (R, C, 3) with normals of any length (R, C, 3).

    It faces outwards where columns go round it counter-clockwise, seen from the end that rows go to.
    """
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.maximum(length, 1e-9)
    rows, columns = np.meshgrid(np.linspace(0, 1, points.shape[0]), np.linspace(0, 1, points.shape[1]), indexing="ij")
    uv = np.stack([columns, rows], axis=2)
    triangles, shading, coordinates = (_triangles(values) for values in (points, normals, uv))
    solid = np.linalg.norm(np.cross(*(triangles[:, 1:] - triangles[:, :1]).swapaxes(0, 1)), axis=1) > 1e-12
    return Part(material, triangles[solid], shading[solid], coordinates[solid])


def surface(points: Array, material: Material, round_: bool = False, looped: bool = False) -> Part:
    """A grid of points (R, C, 3) that faces as columns x rows, its normals as `normals_of` has them."""
    return grid(points, normals_of(points, round_, looped), material)


def normals_of(points: Array, round_: bool = False, looped: bool = False) -> Array:
    """Unit normals (R, C, 3) of a grid, along columns x rows: from the cells about each point, by their size.

    round_: the last column is the first one again. looped: the last row is.
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
    # Where folds leave a corner without a direction it takes the whole's.
    length = np.linalg.norm(total, axis=2, keepdims=True)
    total = np.where(length > 1e-14, total / np.maximum(length, 1e-14), total.sum(axis=(0, 1)))
    return total / np.maximum(np.linalg.norm(total, axis=2, keepdims=True), 1e-12)


def _triangles(values: Array) -> Array:
    """Two triangles of every cell of a grid (R, C, D), counter-clockwise, (2 cells, 3, D)."""
    sides = (values[:-1, :-1], values[:-1, 1:], values[1:, 1:], values[1:, :-1])
    a, b, c, d = (part.reshape(-1, values.shape[2]) for part in sides)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
