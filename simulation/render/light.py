"""Baked diffuse light: area lamps with soft shadows, then a few bounces, once per room.

Direct light is sampled per light point (a texel of a surface's light map, or either side of a solid's vertex). For
the bounces every point sends rays over its hemisphere ONCE and remembers which triangles they meet; each bounce is
then a gather over those same triangles (radiosity with sampled form factors), so that three bounces cost as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from edgemap.simulation.render.mesh import Array, Material, Part, subdivided
from edgemap.simulation.render.raytracer import Raytracer, cosine_directions, r2_sequence
from edgemap.simulation.render.scene import LitPart, LitScene, Scene, Surface


@dataclass(frozen=True, slots=True)
class BakeSettings:
    """How fine the light is. Lengths in metres; samples per point; bounces after the direct light."""

    texel_m: float = 0.03
    vertex_spacing_m: float = 0.12
    lamp_samples: int = 16
    hemisphere_samples: int = 64
    bounces: int = 3


class _Points:
    """Light points and the triangles that look their light up there."""

    def __init__(self) -> None:
        self.positions: list[Array] = []
        self.normals: list[Array] = []
        self.triangles: list[Array] = []
        self.front: list[NDArray[np.int64]] = []
        self.back: list[NDArray[np.int64]] = []
        self.reflectance: list[Array] = []
        self.shifts: list[Array] = []
        self.count = 0

    def add_points(self, positions: Array, normals: Array, shifts: Array | None = None) -> int:
        """shifts: (N, 2) of the sample pattern per point; None where neighbours must share it, to be smooth."""
        first = self.count
        self.shifts.append(np.zeros((len(positions), 2)) if shifts is None else shifts)
        self.positions.append(positions)
        self.normals.append(normals)
        self.count += len(positions)
        return first

    def add_triangles(
        self, triangles: Array, front: NDArray[np.int64], back: NDArray[np.int64], material: Material
    ) -> None:
        self.triangles.append(triangles)
        self.front.append(front)
        self.back.append(back)
        self.reflectance.append(np.broadcast_to(material.mean_reflectance() * material.opacity, (len(triangles), 3)))


def bake(scene: Scene, seed: int, settings: BakeSettings | None = None) -> LitScene:
    """Light a scene. The same seed gives the same light, bit for bit, on one machine."""
    settings = settings or BakeSettings()
    points = _Points()
    rng = np.random.default_rng(seed)
    maps = [_add_surface(points, surface, settings, rng) for surface in scene.surfaces]
    parts = [
        (solid.id, part, *_add_part(points, part))
        for solid in scene.solids
        for part in (subdivided(part, settings.vertex_spacing_m) for part in solid.mesh.parts)
    ]
    tracer = Raytracer(np.concatenate(points.triangles))
    positions, normals = np.concatenate(points.positions), np.concatenate(points.normals)
    shifts = np.concatenate(points.shifts)
    direct = _direct(tracer, positions, normals, shifts, scene, settings.lamp_samples)
    bounced = _bounced(tracer, points, positions, normals, shifts, direct, settings)
    surfaces = tuple(
        (surface, _light_map(direct, bounced, *where)) for surface, where in zip(scene.surfaces, maps, strict=True)
    )
    total = (direct + bounced).astype(np.float32)
    lit = tuple(LitPart(id_, part, total[front], total[back]) for id_, part, front, back in parts)
    return LitScene(surfaces, lit, scene.lights)


def _add_surface(
    points: _Points, surface: Surface, settings: BakeSettings, rng: np.random.Generator
) -> tuple[int, int, int]:
    """Texels of a surface as light points, and coarse triangles that reflect; (first point, rows, columns)."""
    columns, rows = surface.texels(settings.texel_m)
    a, b = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    positions = surface.corner + a.reshape(-1, 1) * surface.u + b.reshape(-1, 1) * surface.v
    first = points.add_points(
        positions, np.broadcast_to(surface.normal, positions.shape), rng.random((len(positions), 2))
    )
    part = subdivided(surface.part(), 0.25)
    offset = part.positions - surface.corner
    column = np.clip(offset @ surface.u / (surface.u @ surface.u) * columns, 0, columns - 1).astype(np.int64)
    row = np.clip(offset @ surface.v / (surface.v @ surface.v) * rows, 0, rows - 1).astype(np.int64)
    texel = first + row * columns + column
    points.add_triangles(part.positions, texel, texel, surface.material)
    return first, rows, columns


def _add_part(points: _Points, part: Part) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Both sides of a part's distinct corners as light points; indices (T, 3) of the front and back ones.

    The front is where the shading normals point, whatever way the triangles are wound.
    """
    rows = np.concatenate([part.positions.reshape(-1, 3) * 1e3, part.normals.reshape(-1, 3) * 8.0], axis=1)
    _, keep, inverse = np.unique(np.round(rows).astype(np.int32), axis=0, return_index=True, return_inverse=True)
    positions, normals = part.positions.reshape(-1, 3)[keep], part.normals.reshape(-1, 3)[keep]
    front = points.add_points(positions, normals) + inverse.reshape(-1, 3)
    back = points.add_points(positions, -normals) + inverse.reshape(-1, 3)
    wound = np.cross(part.positions[:, 1] - part.positions[:, 0], part.positions[:, 2] - part.positions[:, 0])
    agrees = ((wound * part.normals.mean(axis=1)).sum(axis=1) >= 0.0)[:, None]
    points.add_triangles(part.positions, np.where(agrees, front, back), np.where(agrees, back, front), part.material)
    return front, back


def _direct(tracer: Raytracer, positions: Array, normals: Array, shifts: Array, scene: Scene, samples: int) -> Array:
    """Irradiance / pi (N, 3) straight from the lamps."""
    light = np.zeros((len(positions), 3))
    for lamp in scene.lights:
        area = float(np.linalg.norm(np.cross(lamp.u, lamp.v)))
        for sample in r2_sequence(samples):
            at = (sample + shifts) % 1.0
            target = lamp.corner + at[:, :1] * lamp.u + at[:, 1:] * lamp.v
            way = target - positions
            distance2 = np.maximum((way * way).sum(axis=1), 0.05**2)
            way = way / np.sqrt(distance2)[:, None]
            factor = np.maximum((way * normals).sum(axis=1), 0.0) * np.maximum(-(way @ lamp.normal), 0.0)
            factor *= area / (np.pi * distance2 * samples)
            lit = np.flatnonzero(factor > 1e-6)
            seen = lit[tracer.visible(positions[lit], normals[lit], target[lit])]
            light[seen] += factor[seen, None] * lamp.radiance
    return light


def _bounced(
    tracer: Raytracer,
    points: _Points,
    positions: Array,
    normals: Array,
    shifts: Array,
    direct: Array,
    settings: BakeSettings,
) -> Array:
    """Irradiance / pi (N, 3) that comes back from other surfaces."""
    sources = np.empty((settings.hemisphere_samples, len(positions)), dtype=np.int32)
    count = len(tracer.triangles)
    for i, sample in enumerate(r2_sequence(settings.hemisphere_samples)):
        hit, is_front = tracer.first_hits(positions, normals, cosine_directions(normals, (sample + shifts) % 1.0))
        # Row `2 * count` stands for "met nothing" and stays dark.
        sources[i] = np.where(hit < 0, 2 * count, np.where(is_front, hit, hit + count))
    corners = np.concatenate([*points.front, *points.back])
    reflectance = np.concatenate([*points.reflectance, *points.reflectance])
    bounced = np.zeros_like(direct)
    for _ in range(settings.bounces):
        sent = np.zeros((2 * count + 1, 3), dtype=np.float32)
        sent[:-1] = reflectance * (direct + bounced)[corners].mean(axis=1)
        bounced = sum((sent[row] for row in sources), np.zeros_like(direct)) / settings.hemisphere_samples
    return bounced


def _light_map(direct: Array, bounced: Array, first: int, rows: int, columns: int) -> NDArray[np.float32]:
    """One surface's light map; sampling noise is blurred away, bounced light more than the sharper direct light."""
    part = slice(first, first + rows * columns)
    smooth = [
        gaussian_filter(light[part].reshape(rows, columns, 3), (sigma, sigma, 0.0), mode="nearest")
        for light, sigma in ((direct, 0.8), (bounced, 2.0))
    ]
    return (smooth[0] + smooth[1]).astype(np.float32)
