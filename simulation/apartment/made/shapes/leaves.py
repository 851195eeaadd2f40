"""Leaves of all shapes, many at once."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.shapes.lofts import triangles
from edgemap.simulation.render.mesh import Array, Material, Part

# Half widths along a leaf, 0 at its base to 1 at its tip; the widest is 1.
SHAPES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "oval": ((0.0, 0.25, 0.5, 0.8, 1.0), (0.05, 0.8, 1.0, 0.6, 0.0)),
    "spoon": ((0.0, 0.3, 0.7, 0.9, 1.0), (0.1, 0.4, 1.0, 0.8, 0.0)),
    "heart": ((0.0, 0.08, 0.25, 0.6, 1.0), (0.3, 0.85, 1.0, 0.65, 0.0)),
    "lance": ((0.0, 0.2, 0.45, 0.75, 1.0), (0.15, 0.75, 1.0, 0.6, 0.0)),
    "blade": ((0.0, 0.1, 0.5, 0.85, 1.0), (0.6, 0.85, 1.0, 0.6, 0.0)),
}


def leaves(
    base: Array,
    towards: Array,
    length: ArrayLike,
    width: ArrayLike,
    materials: list[Material],
    shape: str = "oval",
    droop: ArrayLike = 0.5,
    fold: float = 0.25,
    rows: int = 5,
) -> list[Part]:
    """Leaves from base (N, 3) towards (N, 3), each length and width in metres (N,) or one.

    droop: by how many radians each bends down towards its tip; fold: how deep its V is against its half width;
    rows: how finely its length is cut. One part per material, leaves in turn.
    """
    count = len(base)
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
    level = np.hypot(towards[:, 0], towards[:, 1])
    heading = np.where(level > 1e-3, np.arctan2(towards[:, 1], towards[:, 0]), np.arange(count) * 2.4)
    ahead = np.stack([np.cos(heading), np.sin(heading), np.zeros(count)], axis=1)
    side = np.stack([-np.sin(heading), np.cos(heading), np.zeros(count)], axis=1)
    rise = np.arctan2(towards[:, 2], level)[:, None]
    t = np.linspace(0.0, 1.0, rows)
    pitch = rise - np.broadcast_to(np.asarray(droop, dtype=np.float64), (count,))[:, None] * t[None]
    middle = (pitch[:, 1:] + pitch[:, :-1]) / 2.0
    step = (np.broadcast_to(np.asarray(length, dtype=np.float64), (count,)) / (rows - 1))[:, None]
    out, up = (
        np.concatenate([np.zeros((count, 1)), np.cumsum(part * step, axis=1)], axis=1)
        for part in (np.cos(middle), np.sin(middle))
    )
    spine = base[:, None] + out[..., None] * ahead[:, None] + up[..., None] * [0.0, 0.0, 1.0]
    over = -np.sin(pitch)[..., None] * ahead[:, None] + np.cos(pitch)[..., None] * np.array([0.0, 0.0, 1.0])
    half = np.maximum(PchipInterpolator(*SHAPES[shape])(t), 0.004) / 2.0
    wide = np.broadcast_to(np.asarray(width, dtype=np.float64), (count,))[:, None] * half[None]
    edges = [spine + s * wide[..., None] * side[:, None] + fold * abs(s) * wide[..., None] * over for s in (1, 0, -1)]
    points = np.stack(edges, axis=2)
    return [_part(points[i :: len(materials)], t, material) for i, material in enumerate(materials) if i < count]


def _part(points: Array, t: Array, material: Material) -> Part:
    """Grids (N, R, 3, 3) as one part, each half of a leaf flat across, smooth along."""
    v = np.broadcast_to(t[:, None], (len(t), 3))
    uv = np.broadcast_to(np.stack([np.broadcast_to([0.0, 0.5, 1.0], v.shape), v], axis=2), (*points.shape[:3], 2))
    halves = []
    for left, right in pairwise(range(3)):
        corners = points[:, :, [left, right]]
        normals = np.cross(np.gradient(corners.mean(axis=2), axis=1), corners[:, :, 1] - corners[:, :, 0])
        normals = -np.repeat(normals[:, :, None], 2, axis=2)
        normals /= np.maximum(np.linalg.norm(normals, axis=3, keepdims=True), 1e-12)
        halves.append([triangles(values) for values in (corners, normals, uv[:, :, [left, right]])])
    return Part(material, *map(np.concatenate, zip(*halves, strict=True)))
