"""Baked diffuse light: area lights with soft shadows, then a few bounces, once per home, apart for lamps and day.

Direct light is sampled per texel of a surface's light map and per light point of a solid; bounced light, which varies
slowly, on a coarser grid. For the bounces every point sends rays over its hemisphere ONCE and remembers which
triangles they meet; each bounce is then a gather over those same triangles (radiosity with sampled form factors), so
that three bounces cost as one. Both groups of light travel together, as six channels: lamps, then day.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from edgemap.simulation.render.light_points import Points, Reflector, SolidPoints, SurfacePoints, probe_grid
from edgemap.simulation.render.mesh import triangles_of
from edgemap.simulation.render.raytracer import Raytracer, cosine_directions, in_pieces, r2_sequence
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, Light, LitScene, LitSurface, Probes, Scene

# Light fainter than this is not worth a ray: a hundredth of a dim room.
_FAINT = 0.003
# So many rays in vain, and a light counts as hidden from a point.
_TRIES = 4
# Trim nearer than this before a wall hides the wall.
_BURIED_M = 0.05


@dataclass(frozen=True, slots=True)
class BakeSettings:
    """How fine the light is. Lengths in metres; samples per point; bounces after the direct light.

    texel_m: light maps; gather_m: where light maps gather bounced light; cluster_m: light points of solids;
    vertex_spacing_m: longest edge that light may vary along. behind_samples: for the backs of solids, which are mostly
    inside of them; hemisphere_samples: for all else.
    """

    texel_m: float = 0.04
    gather_m: float = 0.12
    cluster_m: float = 0.05
    vertex_spacing_m: float = 0.15
    lamp_samples: int = 16
    hemisphere_samples: int = 48
    behind_samples: int = 16
    bounces: int = 3

    @classmethod
    def draft(cls) -> "BakeSettings":
        """Good enough to train on, several times faster."""
        return cls(0.08, 0.25, 0.12, 0.3, 4, 12, 12, 2)


def bake(scene: Scene, seed: int, settings: BakeSettings | None = None) -> LitScene:
    """Light a scene. The same seed gives the same light, bit for bit, on one machine."""
    settings = settings or BakeSettings()
    rng = np.random.default_rng(seed)
    surfaces = [SurfacePoints(surface, settings.texel_m, settings.gather_m, rng) for surface in scene.surfaces]
    solids = SolidPoints(scene.solids, settings.vertex_spacing_m, settings.cluster_m)
    corner, step, shape, air = probe_grid(scene)
    # Light points are numbered in one row: the surfaces' coarse ones, the air's, those of the solids.
    starts = np.cumsum([0, *(len(surface.coarse) for surface in surfaces), len(air)]).tolist()
    reflecting = [surface.reflector(first) for surface, first in zip(surfaces, starts[:-2], strict=True)]
    reflecting.append(solids.reflector(starts[-1]))
    tracer = Raytracer(np.concatenate([part.triangles for part in reflecting]))
    trim = Raytracer(triangles_of(scene.solids[ROOM_ID]))
    # All in one go: most surfaces are too small to be shared out to the processors by themselves.
    everywhere = Points.joined([*(surface.fine for surface in surfaces), air, solids.points])
    ends = np.cumsum([len(surface.fine) for surface in surfaces], dtype=np.int64)
    *direct_maps, elsewhere = np.split(_direct(tracer, everywhere, scene, settings.lamp_samples), ends)
    for surface in surfaces:
        surface.hide(trim, _BURIED_M)
    gathering = Points.joined([*(surface.coarse for surface in surfaces), air, solids.points])
    direct = np.concatenate(
        [surface.coarsened(light) for surface, light in zip(surfaces, direct_maps, strict=True)] + [elsewhere]
    )
    outside = len(gathering) - len(solids.points) // 2
    sources = (
        _first_hits(tracer, gathering[:outside], settings.hemisphere_samples),
        _first_hits(tracer, gathering[outside:], settings.behind_samples),
    )
    bounced = _bounced(sources, reflecting, direct, settings.bounces)
    # The share of a point's rays that meet a wall, floor or ceiling from behind is 1 inside of walls.
    count, of_surfaces = len(tracer.triangles), len(tracer.triangles) - len(reflecting[-1].triangles)
    open_ = ((sources[0] >= count) & (sources[0] < count + of_surfaces)).mean(axis=1) < 0.5
    lit_surfaces = [
        LitSurface(surface.surface, surface.light_map(light, bounced[first:end], open_[first:end]))
        for surface, light, (first, end) in zip(surfaces, direct_maps, pairwise(starts[:-1]), strict=True)
    ]
    total = direct + bounced
    cubes = total[starts[-2] : starts[-1]].reshape(*shape, 6, 6)
    parts = solids.lit(total[starts[-1] :])
    return LitScene(tuple(lit_surfaces), tuple(parts), scene.lights, Probes(corner, step, cubes))


def _direct(tracer: Raytracer, points: Points, scene: Scene, samples: int) -> Light:
    """Irradiance / pi (N, 6) straight from the lights."""

    def piece(some: slice) -> Light:
        here = points[some]
        light = np.zeros((len(here), 6), dtype=np.float32)
        for lamp in scene.lights:
            first = 3 if lamp.group == "day" else 0
            share = _from_one(tracer, here, lamp, samples)
            light[:, first : first + 3] += share[:, None] * lamp.radiance.astype(np.float32)
        return light

    return in_pieces(piece, len(points))


def _from_one(tracer: Raytracer, points: Points, lamp: AreaLight, samples: int) -> Light:
    """What share (N,) of a light's radiance arrives, divided by pi."""
    area, reach = float(np.linalg.norm(np.cross(lamp.u, lamp.v))), float(np.linalg.norm(lamp.u + lamp.v)) / 2.0
    corner, u, v, shine = (np.asarray(a, dtype=np.float32) for a in (lamp.corner, lamp.u, lamp.v, lamp.normal))
    share = np.zeros(len(points), dtype=np.float32)
    way = lamp.centre.astype(np.float32) - points.positions
    bright = area * float(np.max(lamp.radiance)) / (np.pi * np.maximum(_dot(way, way), 0.01)) > _FAINT
    todo = np.flatnonzero(bright & (_dot(way, points.normals) > -reach) & (way @ shine < reach))
    points = points[todo]
    arrived, seen = np.zeros(len(todo), dtype=np.float32), np.zeros(len(todo), dtype=bool)
    for number, sample in enumerate(r2_sequence(samples).astype(np.float32)):
        if number == _TRIES:
            share[todo] = arrived
            todo, arrived, points = todo[seen], arrived[seen], points[seen]
        if not len(todo):
            break
        at = (sample + points.shifts) % 1.0
        target = corner + at[:, :1] * u + at[:, 1:] * v
        way = target - points.positions
        distance2 = np.maximum(_dot(way, way), 0.05**2)
        cosines = np.maximum(_dot(way, points.normals), 0.0) * np.maximum(-(way @ shine), 0.0)
        factor = cosines * (area / np.pi / samples) / (distance2 * distance2)
        lit = np.flatnonzero(factor > 0.0)
        open_ = lit[tracer.visible(points.positions[lit], points.normals[lit], target[lit])]
        arrived[open_] += factor[open_]
        if number < _TRIES:
            seen[open_] = True
    share[todo] = arrived
    return share


def _first_hits(tracer: Raytracer, points: Points, samples: int) -> NDArray[np.int32]:
    """Which triangle each of a point's rays over its hemisphere meets first: (N, samples), plus the number of
    triangles where it meets the back; twice that number for none."""
    count = len(tracer.triangles)
    pattern = r2_sequence(samples).astype(np.float32)

    def piece(some: slice) -> NDArray[np.int32]:
        here = points[some]
        sources = np.empty((len(here), samples), dtype=np.int32)
        for i, sample in enumerate(pattern):
            directions = cosine_directions(here.normals, (sample + here.shifts) % 1.0)
            hit, front = tracer.first_hits(here.positions, here.normals, directions)
            sources[:, i] = np.where(hit < 0, 2 * count, np.where(front, hit, hit + count))
        return sources

    return in_pieces(piece, len(points))


def _bounced(
    sources: Sequence[NDArray[np.int32]], reflecting: Sequence[Reflector], direct: Light, bounces: int
) -> Light:
    """Irradiance / pi (N, 6) that comes back from other surfaces. sources: of the first points, then of the others."""
    corners = np.concatenate([part.front for part in reflecting] + [part.back for part in reflecting])
    reflectance = np.concatenate([part.reflectance for part in reflecting]).astype(np.float32)
    both, bounced = np.tile(reflectance, (2, 2)), np.zeros_like(direct)
    for _ in range(bounces):
        light = direct + bounced
        sent = np.zeros((len(corners) + 1, 6), dtype=np.float32)
        sent[:-1] = both * ((light[corners[:, 0]] + light[corners[:, 1]] + light[corners[:, 2]]) / 3.0)
        bounced = np.concatenate([_gathered(some, sent) for some in sources])
    return bounced


def _gathered(sources: NDArray[np.int32], sent: Light) -> Light:
    """Mean (N, 6) of what the sources (N, samples) of each point send."""

    def piece(some: slice) -> Light:
        rows = sources[some]
        ends = np.arange(0, rows.size + 1, rows.shape[1], dtype=np.int32)
        share = np.full(rows.size, 1.0 / rows.shape[1], dtype=np.float32)
        # A product with a sparse matrix reads each source once, where indexing would copy them all.
        return csr_array((share, rows.ravel(), ends), shape=(len(rows), len(sent))) @ sent

    return in_pieces(piece, len(sources))


def _dot(a: Light, b: Light) -> Light:
    """Products (N,) of vectors (N, 3)."""
    return np.einsum("ij,ij->i", a, b)
