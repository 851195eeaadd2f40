"""What models of our own are put together from: boxes, cushions, tubes, turned bodies, and materials for them.

All in metres, x out of a piece's front, y left, z up.
"""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, box

BLACK = Material((0.015, 0.015, 0.017), gloss=0.25)
STEEL = Material((0.45, 0.45, 0.46), gloss=0.5)
_TEXTURE_PX = 128


def drawn_colour(rng: np.random.Generator, saturation: float = 0.8) -> tuple[float, float, float]:
    """Any colour, linear, up to this saturation."""
    value = float(rng.uniform(0.08, 0.75))
    return colorsys.hsv_to_rgb(float(rng.random()), float(rng.uniform(0.0, saturation)), value)


def wood(rng: np.random.Generator) -> Material:
    """Oiled, stained or painted wood, with or without grain."""
    if rng.random() < 0.3:
        return Material(drawn_colour(rng, 0.4), gloss=float(rng.uniform(0.0, 0.3)))
    hue, value = float(rng.uniform(0.05, 0.11)), float(np.exp(rng.uniform(np.log(0.06), np.log(0.75))))
    colour = colorsys.hsv_to_rgb(hue, float(rng.uniform(0.25, 0.7)), value)
    grain = noise(rng, _TEXTURE_PX, _TEXTURE_PX, stretch=float(rng.uniform(6.0, 20.0)), slope=0.8)
    return Material(colour, _grey(1.0 + 0.07 * grain), gloss=float(rng.uniform(0.0, 0.25)))


def fabric(rng: np.random.Generator) -> Material:
    """Cloth: plain, mottled, striped or checked; now and then leather."""
    colour = drawn_colour(rng, 0.7)
    way = rng.random()
    if way < 0.2:
        return Material(colour, gloss=float(rng.uniform(0.1, 0.3)))
    field = 1.0 + float(rng.uniform(0.02, 0.1)) * noise(
        rng, _TEXTURE_PX, _TEXTURE_PX, slope=float(rng.uniform(0.1, 1.2))
    )
    if way > 0.6:
        bands = np.arange(_TEXTURE_PX) * int(rng.integers(2, 12)) // _TEXTURE_PX % 2
        both = np.maximum(bands[:, None], bands[None]) if way > 0.8 else np.broadcast_to(bands, field.shape)
        field = field * np.where(both, float(rng.uniform(0.4, 0.9)), 1.0)
    return Material(colour, _grey(field))


def plastic(rng: np.random.Generator) -> Material:
    """Moulded plastic or lacquer in any colour, often white or black."""
    if rng.random() < 0.4:
        value = float(rng.choice([0.02, 0.1, 0.6, 0.75]))
        return Material((value, value, value), gloss=float(rng.uniform(0.0, 0.4)))
    return Material(drawn_colour(rng), gloss=float(rng.uniform(0.05, 0.4)))


def metal(rng: np.random.Generator) -> Material:
    """Steel, chrome, brass or painted black."""
    colours = ((0.45, 0.45, 0.46), (0.6, 0.6, 0.62), (0.45, 0.33, 0.12), (0.02, 0.02, 0.02), (0.7, 0.7, 0.7))
    return Material(colours[int(rng.integers(len(colours)))], gloss=float(rng.uniform(0.2, 0.6)))


def _grey(field: Array) -> np.ndarray:
    """A texture that only shades a colour: field (H, W) about 1."""
    texels = np.full((*field.shape, 4), 255, dtype=np.uint8)
    texels[..., :3] = np.clip(field[..., None] * 225.0, 0.0, 255.0).astype(np.uint8)
    return texels


def block(x: float, y: float, z: float, depth: float, width: float, height: float, material: Material) -> Mesh:
    """A box of a size whose lower face has its middle at (x, y, z)."""
    low = np.array([x - depth / 2.0, y - width / 2.0, z])
    return box(low, low + [depth, width, height], material)


def cushion(middle: ArrayLike, size: ArrayLike, material: Material, squareness: float = 4.0) -> Mesh:
    """A padded body (superellipsoid) about a middle (3,) with outer sizes (3,); squareness 2 is an ellipsoid, 8 a
    box with soft edges."""
    exponent = 2.0 / squareness
    along, up = np.linspace(-np.pi, np.pi, 25), np.linspace(-np.pi / 2.0, np.pi / 2.0, 13)

    def rounded(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** exponent

    flat = rounded(np.cos(up))
    unit = np.stack(
        [
            flat[:, None] * rounded(np.cos(along))[None],
            flat[:, None] * rounded(np.sin(along))[None],
            np.broadcast_to(rounded(np.sin(up))[:, None], (len(up), len(along))),
        ],
        axis=2,
    )
    half = np.asarray(size, dtype=np.float64) / 2.0
    normals = np.sign(unit) * np.abs(unit) ** (squareness - 1.0) / half
    return Mesh((grid(np.asarray(middle) + unit * half, normals, material),))


def tube(start: ArrayLike, end: ArrayLike, radius: float, material: Material, end_radius: float | None = None) -> Mesh:
    """A round bar between two points (3,), closed; end_radius: where it tapers."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.7 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    turn = np.linspace(0.0, 2.0 * np.pi, 11)
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    radii = np.array([0.0, radius, radius if end_radius is None else end_radius, 0.0])
    at = np.array([start, start, end, end])
    points = at[:, None] + radii[:, None, None] * around
    parts = []
    for row, facing in ((0, -axis), (1, None), (2, axis)):
        normals = around if facing is None else np.broadcast_to(facing, around.shape)
        parts.append(grid(points[row : row + 2], np.stack([normals, normals]), material))
    return Mesh(tuple(parts))


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


def _triangles(values: Array) -> Array:
    """Two triangles of every cell of a grid (R, C, D), counter-clockwise, (2 cells, 3, D)."""
    sides = (values[:-1, :-1], values[:-1, 1:], values[1:, 1:], values[1:, :-1])
    a, b, c, d = (part.reshape(-1, values.shape[2]) for part in sides)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    return Mesh(tuple(part for mesh in meshes for part in mesh.parts))


def centred(mesh: Mesh) -> Mesh:
    """The mesh with its origin on the floor at its box's centre."""
    points = mesh.triangles().reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    shift = -np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    return Mesh(tuple(part.moved(np.eye(3), shift) for part in mesh.parts))
