"""Fewer triangles for models with more than a robot's camera can show: vertices that share a small cell become one."""

import numpy as np

from edgemap.simulation.render.mesh import Array, Mesh, Part

_FINEST_M, _COARSEST_M, _GROWTH = 0.002, 0.03, 1.3


def simplified(mesh: Mesh, most: int) -> Mesh:
    """The mesh with about `most` triangles or fewer, cells as fine as that allows (2 mm to 3 cm).

    Vertex clustering (Rossignac and Borrel, 1993). A corner keeps its normal and texture coordinates and moves to the
    mean of its cell; triangles that lose their area, or lie on another one, are dropped.
    """
    cell, result = _FINEST_M, mesh
    while sum(len(part.positions) for part in result.parts) > most and cell < _COARSEST_M:
        result = Mesh(tuple(_clustered(part, cell) for part in mesh.parts))
        cell *= _GROWTH
    return result


def _clustered(part: Part, cell_m: float) -> Part:
    points: Array = part.positions.reshape(-1, 3)
    keys = np.round(points / cell_m).astype(np.int64)
    keys -= keys.min(axis=0)
    # One number per cell: sorting those is many times faster than sorting rows.
    _, cluster = np.unique((keys[:, 0] << 40) | (keys[:, 1] << 20) | keys[:, 2], return_inverse=True)
    count = np.bincount(cluster)
    means = np.stack([np.bincount(cluster, weights=points[:, axis]) / count for axis in range(3)], axis=1)
    corners = cluster.reshape(-1, 3)
    a, b, c = corners.T
    solid = np.flatnonzero((a != b) & (b != c) & (a != c))
    low, middle, high = np.sort(corners[solid], axis=1).T
    _, first = np.unique((low << 42) | (middle << 21) | high, return_index=True)
    keep = solid[np.sort(first)]
    if not len(keep):
        return part
    return Part(part.material, means[corners[keep]], part.normals[keep], part.uv[keep])
