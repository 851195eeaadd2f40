"""Points at which light is computed: texels of surfaces, selected points of solids, small cubes in mid-air."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from edgemap.simulation.render.mesh import Array, Mesh, Part, subdivided, triangles_of, welded
from edgemap.simulation.render.raytracer import Raytracer
from edgemap.simulation.render.scene import Light, LitPart, Scene, Surface

_REFLECTOR_M, _PROBE_STEP_M, _PROBE_HEIGHT_M, _PROBE_LEVELS = 0.25, 0.6, 0.15, 4
_MOST_TEXELS = 1000  # of a light map's side; the atlas holds no more
_NORMAL_WEIGHT = 1.5  # distance of points of unlike normals, in clusters per radian or so


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Light points: positions, unit normals (N, 3); shifts (N, 2) of the sample pattern, the same where neighbours
    must agree to be smooth."""

    positions: Light
    normals: Light
    shifts: Light

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, some: slice | NDArray[Any]) -> "Points":
        return Points(self.positions[some], self.normals[some], self.shifts[some])

    @classmethod
    def joined(cls, some: Sequence["Points"]) -> "Points":
        """All of them in one list."""
        return cls(*(np.concatenate([getattr(p, n) for p in some]) for n in ("positions", "normals", "shifts")))


@dataclass(frozen=True, slots=True, eq=False)
class Reflector:
    """Triangles (T, 3, 3) that send light on: numbers (T, 3) of the light points at the corners of their front (which
    way they are wound) and back, and their linear reflectance (T, 3)."""

    triangles: Array
    front: NDArray[np.int64]
    back: NDArray[np.int64]
    reflectance: Array


class SurfacePoints:
    """A surface's texels: `fine` ones for direct light, `coarse` ones that gather bounced light."""

    def __init__(self, surface: Surface, texel_m: float, gather_m: float, rng: np.random.Generator) -> None:
        self.surface = surface
        columns, rows = surface.texels(texel_m)
        self.shape = min(rows, _MOST_TEXELS), min(columns, _MOST_TEXELS)
        columns, rows = surface.texels(gather_m)
        self.coarse_shape = min(rows, self.shape[0]), min(columns, self.shape[1])
        self.fine = self._texels(self.shape, rng)
        self.coarse = self._texels(self.coarse_shape, rng)

    def hide(self, trim: Raytracer, reach_m: float) -> None:
        """Leave out the texels that trim (skirting, frames) covers, for their darkness would show beside it."""
        self._open, self._coarse_open = (
            trim.visible(p.positions, p.normals, p.positions + p.normals * np.float32(reach_m)).reshape(shape)
            for p, shape in ((self.fine, self.shape), (self.coarse, self.coarse_shape))
        )

    def coarsened(self, light: Light) -> Light:
        """Light at coarse texels (M, 6) from that at fine ones (N, 6)."""
        return _resized(light.reshape(*self.shape, 6), self.coarse_shape, cv2.INTER_AREA).reshape(-1, 6)

    def light_map(self, direct: Light, bounced: Light, open_coarse: NDArray[np.bool_]) -> Light:
        """The map (rows, columns, 6) of direct light at fine texels (N, 6) and bounced light at coarse ones (M, 6).

        Noise is blurred away, of bounced light more than of the sharper direct light; covered texels take over their
        neighbours'. open_coarse: (M,), those that are not inside of walls.
        """
        coarse = open_coarse.reshape(self.coarse_shape)
        inside = cv2.resize(coarse.astype(np.uint8), self.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        smooth = _smooth(bounced.reshape(*self.coarse_shape, 6), self._coarse_open & coarse)
        fine = _smooth(direct.reshape(*self.shape, 6), self._open & inside)
        return fine + _resized(smooth, self.shape, cv2.INTER_LINEAR)

    def reflector(self, first: int) -> Reflector:
        """Triangles of the surface, lit by its coarse texels. first: number of its first light point."""
        surface, (rows, columns) = self.surface, self.coarse_shape
        part = subdivided(surface.part(), _REFLECTOR_M)
        offset = part.positions - surface.corner
        column = np.clip(offset @ surface.u / (surface.u @ surface.u) * columns, 0, columns - 1).astype(np.int64)
        row = np.clip(offset @ surface.v / (surface.v @ surface.v) * rows, 0, rows - 1).astype(np.int64)
        texel = first + row * columns + column
        return Reflector(part.positions, texel, texel, _reflectance(part))

    def _texels(self, shape: tuple[int, int], rng: np.random.Generator) -> Points:
        rows, columns = shape
        a, b = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        surface = self.surface
        positions = surface.corner + a.reshape(-1, 1) * surface.u + b.reshape(-1, 1) * surface.v
        normals = np.broadcast_to(surface.normal, positions.shape)
        return Points(positions.astype(np.float32), normals.astype(np.float32), rng.random((len(positions), 2), "f4"))


class SolidPoints:
    """Light points of solids: one corner for all corners of a solid near it that face the same way; both its sides.
    points: all fronts, then all backs."""

    def __init__(self, solids: dict[int, Mesh], spacing_m: float, cluster_m: float) -> None:
        self._parts = [(id_, subdivided(part, spacing_m)) for id_, mesh in solids.items() for part in mesh]
        self._cluster_m = cluster_m
        positions, normals = (
            np.concatenate([getattr(part, name).reshape(-1, 3) for _, part in self._parts]).astype(np.float32)
            for name in ("positions", "normals")
        )
        counts = [3 * len(part.positions) for _, part in self._parts]
        ids = np.repeat(np.array([id_ for id_, _ in self._parts], dtype=np.int16), counts)
        corners = np.concatenate([_bytes(np.round(positions * 1e3), "i4"), _bytes(np.round(normals * 8.0), "i1")], 1)
        keep, corner = welded(corners)
        self._positions, self._normals = positions[keep], normals[keep]
        cells = [
            _bytes(np.floor(self._positions / cluster_m), "i2"),
            _bytes(np.round(self._normals * 1.5), "i1"),
            _bytes(ids[keep, None], "i2"),
        ]
        chosen, cluster = welded(np.concatenate(cells, axis=1))
        # Welding leaves all in disorder; in the order of the meshes neighbours' rays meet the same triangles, which are
        # then still in the processor's cache: half the time.
        order, number = _ranked(keep)
        self._positions, self._normals, self._corner = self._positions[order], self._normals[order], number[corner]
        chosen, cluster = number[chosen], cluster[order]
        order, number = _ranked(chosen)
        self._chosen, self._cluster = chosen[order], number[cluster]
        at, normals = self._positions[self._chosen], self._normals[self._chosen]
        self._count = len(chosen)
        none = np.zeros((2 * self._count, 2), dtype=np.float32)
        self.points = Points(np.concatenate([at, at]), np.concatenate([normals, -normals]), none)

    def reflector(self, first: int) -> Reflector:
        """Triangles of the solids. The front is where the shading normals point, independent of the winding. first:
        number of their first light point."""
        triangles = triangles_of([part for _, part in self._parts])
        normals = np.concatenate([part.normals.mean(axis=1) for _, part in self._parts])
        wound = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        agrees = ((wound * normals).sum(axis=1) >= 0.0)[:, None]
        front = first + self._cluster[self._corner].reshape(-1, 3)
        back = front + self._count
        reflectance = np.concatenate([_reflectance(part) for _, part in self._parts])
        return Reflector(triangles, np.where(agrees, front, back), np.where(agrees, back, front), reflectance)

    def lit(self, light: Light) -> list[LitPart]:
        """The parts with the light (2 N, 6) of their points, blended between the nearest ones that face alike."""
        keys = np.concatenate([self._positions / self._cluster_m, self._normals * _NORMAL_WEIGHT], axis=1)
        nearest = min(4, self._count)
        distance, index = KDTree(keys[self._chosen]).query(keys, k=nearest, workers=-1)
        distance, index = distance.reshape(-1, nearest), index.reshape(-1, nearest)
        weights = np.exp(-1.5 * distance**2) + 1e-9
        weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
        sides = [
            np.asarray(sum(weights[:, k, None] * side[index[:, k]] for k in range(nearest)))[self._corner]
            for side in (light[: self._count], light[self._count :])
        ]
        done, at = [], 0
        for id_, part in self._parts:
            some = slice(at, at + 3 * len(part.positions))
            done.append(LitPart(id_, part, *(side[some].reshape(-1, 3, 6) for side in sides)))
            at = some.stop
        return done


def probe_grid(scene: Scene) -> tuple[Array, Array, tuple[int, int, int], Points]:
    """Small cubes in mid-air over all surfaces: corner and step (3,) in metres, shape, and their faces as points."""
    ends = [s.corner + a * s.u + b * s.v for s in scene.surfaces for a in (0, 1) for b in (0, 1)]
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    counts = np.maximum(np.ceil((high - low)[:2] / _PROBE_STEP_M).astype(int), 1)
    corner = np.array([*(low[:2] + _PROBE_STEP_M / 2.0), low[2] + _PROBE_HEIGHT_M])
    step, shape = np.full(3, _PROBE_STEP_M), (int(counts[0]), int(counts[1]), _PROBE_LEVELS)
    at = corner + np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3) * step
    faces = np.array([sign * np.eye(3)[axis] for axis in range(3) for sign in (1, -1)])
    positions, normals = np.repeat(at, 6, axis=0), np.tile(faces, (len(at), 1))
    none = np.zeros((len(positions), 2), dtype=np.float32)
    return corner, step, shape, Points(positions.astype(np.float32), normals.astype(np.float32), none)


def _reflectance(part: Part) -> Array:
    return np.broadcast_to(part.material.mean_reflectance() * part.material.opacity, (len(part.positions), 3))


def _ranked(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The order of unlike keys (N,), and for each its place in it."""
    order = np.argsort(keys)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return order, place


def _bytes(values: np.ndarray, kind: str) -> NDArray[np.uint8]:
    values = np.ascontiguousarray(values.astype(kind))
    return values.view(np.uint8).reshape(len(values), values.shape[1] * values.itemsize)


def _resized(light: Light, shape: tuple[int, int], interpolation: int) -> Light:
    """Light (rows, columns, 6) at as many rows and columns as `shape`; OpenCV takes up to four channels."""
    halves = [np.ascontiguousarray(half) for half in np.split(light, 2, axis=2)]
    halves = [cv2.resize(half, shape[::-1], interpolation=interpolation) for half in halves]
    return np.asarray(np.concatenate(halves, axis=2), dtype=np.float32)


def _smooth(light: Light, open_: NDArray[np.bool_]) -> Light:
    """Blurred (rows, columns, 6), taking only the open texels; the others get what lies nearest around them."""
    done = np.zeros_like(light)
    missing = np.ones(open_.shape, dtype=bool)
    weight = open_.astype(np.float32)
    for width in (0.8, 2.0, 6.0, 20.0):
        blurred = cv2.GaussianBlur(weight, (0, 0), width, borderType=cv2.BORDER_REPLICATE)
        here = missing & (blurred > 0.02)
        sums = cv2.GaussianBlur(light * weight[..., None], (0, 0), width, borderType=cv2.BORDER_REPLICATE)
        done[here] = sums[here] / blurred[here, None]
        missing &= ~here
        if not missing.any():
            break
    return done
