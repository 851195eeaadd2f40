"""Bodies through rings: lofts, plates, padding, turned bodies; and sheets about a surface."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes.grids import grid, normals_of, surface
from edgemap.simulation.apartment.made.shapes.outlines import raised
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part

# An outline of fewer points has corners, which stay sharp.
_CORNERS = 12


def loft(rings: ArrayLike, material: Material, low: bool = True, high: bool = True) -> Mesh:
    """A surface through closed rings (R, N, 3), smooth all over, with flat ends or without.

    It faces outwards where the rings go round counter-clockwise, seen from the end that they go to.
    """
    rings = np.asarray(rings, dtype=np.float64)
    parts = [surface(rings, material, round_=True)]
    if low:
        parts.append(cap(rings[0, ::-1], material))
    if high:
        parts.append(cap(rings[-1], material))
    return Mesh(tuple(parts))


def cap(ring: Array, material: Material) -> Part:
    """A flat face within a closed star-shaped ring (N, 3), facing where it goes round counter-clockwise.

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


def plate(outline: Array, low: float, high: float, material: Material, taper: float = 1.0) -> Mesh:
    """A level plate of a star-shaped outline (N, 2) between two heights; taper: how much smaller its lower face is."""
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2.0
    rings = np.stack([raised(outline - middle, middle[0], middle[1], low, taper), raised(outline, 0.0, 0.0, high)])
    if len(outline) > _CORNERS:
        return loft(rings, material)
    sides = [surface(rings[:, i : i + 2], material) for i in range(len(outline) - 1)]
    return Mesh((*sides, cap(rings[0, ::-1], material), cap(rings[1], material)))


def pad(outline: Array, low: float, high: float, material: Material, crown: float = 0.015) -> Mesh:
    """A seat's padding of an outline (N, 2) about 0 between two heights, its edges round, its top domed by a crown."""
    edge = min(0.4 * (high - low), 0.03) / float(np.abs(outline).max())
    soft = [(1.0 - edge, low), (1.0, low * 0.7 + high * 0.3), (1.0, low * 0.3 + high * 0.7), (1.0 - 0.4 * edge, high)]
    top = [(1.0 - 1.5 * edge, high + 0.35 * crown), (0.6, high + 0.85 * crown), (0.0, high + crown)]
    return loft([raised(outline, 0.0, 0.0, z, scale) for scale, z in soft + top], material, high=False)


def lathe(radii: Array, heights: Array, material: Material, sides: int = 28) -> Part:
    """A surface of revolution from a profile (N,), smooth all round; it faces outwards where the profile rises."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate(
        [radii[:, None, None] * around, np.broadcast_to(heights[:, None, None], (len(radii), sides + 1, 1))], axis=2
    )
    slope_r, slope_z = np.gradient(radii), np.gradient(heights)
    normals = np.concatenate(
        [slope_z[:, None, None] * around, np.broadcast_to(-slope_r[:, None, None], (len(radii), sides + 1, 1))], axis=2
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return grid(points, normals, material)


def sheet(middle: Array, thickness: float | Array, material: Material, behind: Material | None = None) -> Mesh:
    """A bent sheet about a surface (R, C, 3), whose front has rows to its left-hand way of columns (columns x rows).

    thickness: one, or one at every point (R, C), for padding. behind: material of the back, where it is another.
    """
    half = np.broadcast_to(np.asarray(thickness, dtype=np.float64), middle.shape[:2])[..., None] / 2.0
    facing = normals_of(middle)
    front, back = middle + half * facing, middle - half * facing
    sides = (np.s_[0], np.s_[:, -1], np.s_[-1, ::-1], np.s_[::-1, 0])
    rims = [surface(np.stack([back[side], front[side]]), behind or material) for side in sides]
    return Mesh((surface(front, material), surface(back[:, ::-1], behind or material), *rims))
