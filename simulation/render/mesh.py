"""Triangles with materials: what furniture and walls are made of before light and pixels."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]
Tile = tuple[float, float]
Colour = tuple[float, ...]  # three channels
LightGroup = Literal["day", "lamp"]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """Appearance of a surface. colour: linear reflectance (3,), 0..1; multiplies the texture. texture: (H, W, 4) uint8
    sRGB + alpha, first row at the top (v = 1), repeating; None for plain colour. opacity: 1 is solid. gloss: strength
    of highlights, 0..1. emission: linear radiance (3,), for lamps and windows; group: which light it goes with (a
    window pane with the day).
    """

    colour: Colour = (0.8, 0.8, 0.8)
    texture: NDArray[np.uint8] | None = None
    opacity: float = 1.0
    gloss: float = 0.0
    emission: Colour = (0.0, 0.0, 0.0)
    group: LightGroup = "lamp"

    @property
    def see_through(self) -> bool:
        """True where it is blended over what stands behind."""
        return self.opacity < 0.99

    @property
    def cut_out(self) -> bool:
        """True where the texture has holes (leaves, lattice)."""
        return self.texture is not None and bool((self.texture[..., 3] < 128).any())

    def mean_reflectance(self) -> Array:
        """Linear reflectance (3,) averaged over the texture's solid part."""
        colour = np.asarray(self.colour, dtype=np.float64)
        if self.texture is None:
            return colour
        texels = self.texture[::4, ::4].reshape(-1, 4)
        solid = texels[texels[:, 3] >= 128]
        return colour * srgb_to_linear(solid[:, :3] / 255.0).mean(axis=0) if len(solid) else colour


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Triangles of one material: positions (T, 3, 3) in metres, unit normals (T, 3, 3), texture coordinates
    (T, 3, 2)."""

    material: Material
    positions: Array
    normals: Array
    uv: Array

    def moved(self, rotation: Array, translation_m: Array) -> "Part":
        """The same triangles after `rotation @ p + translation`."""
        return replace(self, positions=self.positions @ rotation.T + translation_m, normals=self.normals @ rotation.T)


Mesh = list[Part]  # in one frame, z up, metres


def placed(mesh: Mesh, pose: SE2, z_m: float) -> Mesh:
    """The mesh turned about z and moved."""
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return [part.moved(rotation, np.array([pose.x_m, pose.y_m, z_m])) for part in mesh]


def triangles_of(mesh: Mesh) -> Array:
    """All triangles, (T, 3, 3) in metres."""
    return np.concatenate([part.positions for part in mesh])


def srgb_to_linear(values: ArrayLike) -> Array:
    """Display values 0..1 to linear light (gamma 2.2 stands for the sRGB curve)."""
    return np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0) ** 2.2


def welded(rows: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Groups equal rows (N, bytes): the first row of each group, and the group of every row. Rows are compared by a
    64-bit hash, many times faster than sorting them.
    """
    padded = np.zeros((len(rows), -(-rows.shape[1] // 8) * 8), dtype=np.uint8)
    padded[:, : rows.shape[1]] = rows
    words = padded.view(np.uint64)
    factors = np.random.default_rng(8).integers(1, 2**63, words.shape[1], dtype=np.uint64) | np.uint64(1)
    sums = np.zeros(len(words), dtype=np.uint64)
    for word, factor in zip(words.T, factors, strict=True):
        sums = (sums ^ (sums >> np.uint64(29))) * np.uint64(0x9E3779B97F4A7C15) + word * factor
    _, keep, inverse = np.unique(sums, return_index=True, return_inverse=True)
    return keep, inverse.ravel()


def quad(corner: ArrayLike, u: ArrayLike, v: ArrayLike, material: Material, tile_m: Tile = (1.0, 1.0)) -> Part:
    """A rectangle from a corner along u and v (metres), facing u x v; the texture repeats every `tile_m` along each."""
    corner, u, v = (np.asarray(a, dtype=np.float64) for a in (corner, u, v))
    points = np.stack([corner, corner + u, corner + u + v, corner + v])
    length, height = np.linalg.norm(u) / tile_m[0], np.linalg.norm(v) / tile_m[1]
    coordinates = np.array([[0.0, 0.0], [length, 0.0], [length, height], [0.0, height]])
    normal = np.cross(u, v)
    order = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.broadcast_to(normal / np.linalg.norm(normal), (2, 3, 3)).copy()
    return Part(material, points[order], normals, coordinates[order])


def box(low: ArrayLike, high: ArrayLike, material: Material) -> Mesh:
    """An axis-aligned box between two corners, faces outward."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    x, y, z = np.diag(high - low)
    faces = [(low, y, x), (low + z, x, y), (low, x, z), (low + y, z, x), (low, z, y), (low + x, y, z)]
    return [quad(corner, u, v, material) for corner, u, v in faces]


def subdivided(part: Part, longest_m: float) -> Part:
    """The same surface with every edge shorter than `longest_m`, so that light kept at corners can vary across it."""
    edges = part.positions[:, [1, 2, 0]] - part.positions
    if np.linalg.norm(edges, axis=2).max(initial=0.0) <= longest_m:
        return part
    rows = np.concatenate([part.positions, part.normals, part.uv], axis=2)
    done = []
    while len(rows):
        edges = np.linalg.norm(rows[:, [1, 2, 0], :3] - rows[:, :, :3], axis=2)
        long = edges.max(axis=1) > longest_m
        done.append(rows[~long])
        rows, edges = rows[long], edges[long]
        at, first = np.arange(len(rows)), edges.argmax(axis=1)
        a, b, c = rows[at, first], rows[at, (first + 1) % 3], rows[at, (first + 2) % 3]
        middle = (a + b) / 2.0
        rows = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    rows = np.concatenate(done)
    return Part(part.material, rows[..., :3], rows[..., 3:6], rows[..., 6:])
