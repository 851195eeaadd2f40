"""Meshes put together, turned and brought to where they belong."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.render.mesh import Mesh


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    return Mesh(tuple(part for mesh in meshes for part in mesh.parts))


def centred(mesh: Mesh) -> Mesh:
    """The mesh with its origin on the floor at its box's centre."""
    points = mesh.triangles().reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    shift = -np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    return Mesh(tuple(part.moved(np.eye(3), shift) for part in mesh.parts))


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
