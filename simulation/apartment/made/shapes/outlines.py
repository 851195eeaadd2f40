"""Closed outlines in a plane, counter-clockwise, their last point the first one again; and paths of straight runs."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.render.mesh import Array


def rectangle(depth: float, width: float, radius: float | None = None, steps: int = 4) -> Array:
    """A rectangle (N, 2) about 0: four sharp corners, or round ones of a radius."""
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])
    if radius is None:
        return _closed(corners * [depth / 2.0, width / 2.0])
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
    """A superellipse (points + 1, 2) about 0: squareness 2 is an ellipse, 20 a rectangle with soft corners.

    behind: squareness of its half of low x, width_behind: its width there, where they are others.
    """
    turn = np.arange(points) * 2.0 * np.pi / points
    c, s = np.cos(turn), np.sin(turn)
    power = 2.0 / np.where(c >= 0.0, squareness, squareness if behind is None else behind)
    x, y = (np.sign(wave) * np.abs(wave) ** power for wave in (c, s))
    rear = width if width_behind is None else width_behind
    return _closed(np.stack([x * depth / 2.0, y * (rear + (width - rear) * (x + 1.0) / 2.0) / 2.0], axis=1))


def raised(outline: Array, x: float, y: float, z: float, scale: float = 1.0) -> Array:
    """An outline (N, 2) as a level ring (N, 3) about a point."""
    return np.concatenate([outline * scale + [x, y], np.full((len(outline), 1), z)], axis=1)


def filleted(corners: ArrayLike, radius: float, steps: int = 5, closed: bool = False) -> Array:
    """A polyline (N, 3) with rounded corners."""
    corners = np.asarray(corners, dtype=np.float64)
    if closed:
        corners = np.concatenate([[(corners[0] + corners[-1]) / 2.0], corners, [(corners[0] + corners[-1]) / 2.0]])
    path, t = [corners[:1]], np.linspace(0.0, 1.0, steps)[:, None]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        ends = []
        for other in (before, after):
            away = float(np.linalg.norm(other - corner))
            ends.append(corner + min(radius, 0.48 * away) * (other - corner) / away)
        path.append((1.0 - t) ** 2 * ends[0] + 2.0 * t * (1.0 - t) * corner + t**2 * ends[1])
    return np.concatenate([*path, corners[-1:]])


def arc(start: ArrayLike, end: ArrayLike, bulge: ArrayLike, points: int = 9) -> Array:
    """A path (points, 3) from start to end along half an ellipse that reaches out by `bulge` (3,)."""
    start, end, bulge = (np.asarray(value, dtype=np.float64) for value in (start, end, bulge))
    turn = np.linspace(0.0, np.pi, points)[:, None]
    return (start + end) / 2.0 - np.cos(turn) * (end - start) / 2.0 + np.sin(turn) * bulge


def _closed(outline: Array) -> Array:
    return np.concatenate([outline, outline[:1]])
