"""More to put models together from: plates and panels cut from sheet, straight beams, bent bars, draped cloth.

All in metres, x out of a piece's front, y left, z up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes import grid, lathe
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part


def rounded_outline(depth: float, width: float, squareness: float, points: int = 40) -> Array:
    """A superellipse (points, 2) counter-clockwise: squareness 2 is an ellipse, 20 a rectangle with soft corners."""
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    shape = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.sign(shape) * np.abs(shape) ** (2.0 / squareness) * [depth / 2.0, width / 2.0]


def rectangle(depth: float, width: float) -> Array:
    """Four corners (4, 2), counter-clockwise."""
    return np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * [depth / 2.0, width / 2.0]


def plate(outline: Array, low: float, thickness: float, material: Material, taper: float = 1.0) -> Mesh:
    """A level plate of a star-shaped outline (N, 2), counter-clockwise; taper: how much smaller its lower face is."""
    count, normal_up = len(outline), np.array([0.0, 0.0, 1.0])
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2.0
    after = np.roll(outline, -1, axis=0)
    parts = []
    for z, facing, scale in ((low + thickness, 1.0, 1.0), (low, -1.0, taper)):
        ring, following = ((middle + (edge - middle) * scale) for edge in (outline, after))
        corners = np.stack([np.broadcast_to(middle, ring.shape), ring, following], axis=1)
        flat = np.concatenate([corners, np.full((count, 3, 1), z)], axis=2)[:, :: int(facing)]
        normals = np.broadcast_to(facing * normal_up, flat.shape).copy()
        parts.append(Part(material, flat, normals, flat[..., :2].copy()))
    ring = np.concatenate([outline, outline[:1]])
    lower = middle + (ring - middle) * taper
    rows = [np.column_stack([edge, np.full(count + 1, z)]) for edge, z in ((lower, low), (ring, low + thickness))]
    # Corners stay sharp: each side is a face of its own where the outline has few.
    if count > 12:
        along = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
        outward = np.column_stack([along[:, 1], -along[:, 0], np.zeros(count)])
        outward = np.concatenate([outward, outward[:1]])
        parts.append(grid(np.stack(rows), np.stack([outward, outward]), material))
    else:
        for i in range(count):
            step = ring[i + 1] - ring[i]
            outward = np.broadcast_to([step[1], -step[0], 0.0], (2, 2, 3))
            parts.append(grid(np.stack([row[i : i + 2] for row in rows]), outward, material))
    return Mesh(tuple(parts))


def panel(along: Array, low: ArrayLike, high: Array, x: float, thickness: float, material: Material) -> Mesh:
    """An upright panel across y: at each place (N,) of `along`, rising, it reaches from `low` to `high`; its back at x.

    It faces x and has edges all round.
    """
    bottom = np.broadcast_to(np.asarray(low, dtype=np.float64), along.shape)
    back, front = (np.full(along.shape, at) for at in (x, x + thickness))

    def strip(*rows: tuple[Array, Array]) -> Array:
        return np.stack([np.column_stack([at, along, z]) for at, z in rows])

    def facing(points: Array) -> Array:
        across, up = np.gradient(points, axis=1), points[1:] - points[:-1]
        return np.cross(across, np.broadcast_to(up, across.shape))

    strips = [
        strip((front, bottom), (front, high)),
        strip((back, high), (back, bottom)),
        strip((front, high), (back, high)),
        strip((back, bottom), (front, bottom)),
    ]
    parts = [grid(points, facing(points), material) for points in strips]
    for i, sign in ((0, -1.0), (-1, 1.0)):
        xs = np.array([x, x + thickness])[:: -int(sign)]
        points = np.array([[[at, along[i], z] for at in xs] for z in (bottom[i], high[i])])
        parts.append(grid(points, np.broadcast_to([0.0, sign, 0.0], points.shape), material))
    return Mesh(tuple(parts))


def beam(start: ArrayLike, end: ArrayLike, size: tuple[float, float], material: Material, taper: float = 1.0) -> Mesh:
    """A square bar between two points (3,); size: its width across x (or z) and across the rest; taper: of its end.

    Ends of a slanting bar are cut level.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.7 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2.0 * size[::-1]
    first = start + corners @ np.stack([side, other])
    last = end + taper * corners @ np.stack([side, other])
    if abs(axis[2]) > 0.25:
        first = first - axis * ((first[:, 2:] - start[2]) / axis[2])
        last = last - axis * ((last[:, 2:] - end[2]) / axis[2])
    parts = []
    for i in range(4):
        face = np.stack([first[i : i + 2], last[i : i + 2]])
        normal = np.cross(face[0, 1] - face[0, 0], face[1, 0] - face[0, 0])
        parts.append(grid(face, np.broadcast_to(normal, face.shape), material))
    for ring, turn in ((first, (1, 0, 2, 3)), (last, (0, 1, 3, 2))):
        face = ring[list(turn)].reshape(2, 2, 3)
        normal = np.cross(face[0, 1] - face[0, 0], face[1, 0] - face[0, 0])
        parts.append(grid(face, np.broadcast_to(normal, face.shape), material))
    return Mesh(tuple(parts))


def bent(path: ArrayLike, radius: ArrayLike, material: Material, sides: int = 8) -> Mesh:
    """A round bar along points (N, 3), of one radius or one for each; its ends are open."""
    points = np.asarray(path, dtype=np.float64)
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    # One direction that is never along the bar keeps the rings from turning against each other.
    spread = np.linalg.svd(points - points.mean(axis=0))[2][2]
    side = np.cross(along, spread)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    other = np.cross(along, side)
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    around = np.cos(turn)[None, :, None] * side[:, None] + np.sin(turn)[None, :, None] * other[:, None]
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(points),))
    return Mesh((grid(points[:, None] + radii[:, None, None] * around, around, material),))


def surface(points: Array, material: Material) -> Part:
    """A smooth surface through a grid of points (R, C, 3), facing as columns x rows."""
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    # Where folds leave a corner without a direction it takes the whole's.
    lost = np.linalg.norm(normals, axis=2) < 1e-8
    normals[lost] = normals.sum(axis=(0, 1))
    return grid(points, normals, material)


def ball(middle: ArrayLike, size: float, material: Material) -> Mesh:
    """A small round knob of a diameter about a middle (3,), cut coarsely."""
    up = np.linspace(-np.pi / 2.0, np.pi / 2.0, 7)
    part = lathe(np.cos(up) * size / 2.0, np.sin(up) * size / 2.0, material, 10)
    return Mesh((part.moved(np.eye(3), np.asarray(middle, dtype=np.float64)),))
