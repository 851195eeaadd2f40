"""Ray-triangle intersection with Embree: occlusion tests, first hits, and sample patterns for both."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array

_OFFSET_M = 0.003
# It is fixed so that results do not depend on the number of processors, and small so that a piece fits in a cache.
_PIECE = 16384


class Raytracer:
    """A search tree of triangles (T, 3, 3), metres, for ray queries."""

    def __init__(self, triangles: Array) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.triangles = triangles
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(triangles, dtype=np.float32))
        # The first ray builds the search tree, which threads must not do at once.
        self.visible(np.zeros((1, 3)), np.zeros((1, 3)), np.ones((1, 3)))

    def visible(self, points: NDArray[Any], normals: NDArray[Any], targets: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether no triangle blocks the segment from each point (N, 3) to its target (N, 3); (N,), metres.

        The segment starts 3 mm from the point along its normal (N, 3), and ends 1 % of its length before the target, so
        that the surfaces at both ends do not block it.
        """
        origins = points + normals * _OFFSET_M
        reach = (targets - origins) * 0.99
        ones = np.ones(len(points), dtype=np.float32)
        origins, reach = (a.astype(np.float32, copy=False) for a in (origins, reach))
        hits = self._scene.run(origins, reach, ones, query="OCCLUDED")
        return np.asarray(hits) < 0

    def first_hits(
        self, points: NDArray[Any], normals: NDArray[Any], directions: NDArray[Any]
    ) -> tuple[NDArray[np.int64], Array]:
        """Index of the triangle that each ray (N, 3) hits first (-1: none), and whether it hits the front; (N,)."""
        origins = (points + normals * _OFFSET_M).astype(np.float32)
        result = self._scene.run(origins, directions.astype(np.float32), query="INTERSECT", output=1)
        hit = np.asarray(result["primID"]).astype(np.int64)
        front = (self.normals[np.maximum(hit, 0)] * directions).sum(axis=1) < 0.0
        return hit, front


def in_pieces(function: Callable[[slice], NDArray[Any]], count: int) -> NDArray[Any]:
    """Calls `function` for consecutive slices of `count` rows on all processors, and joins the results in order."""
    slices = [slice(at, min(at + _PIECE, count)) for at in range(0, count, _PIECE)] or [slice(0, 0)]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return np.concatenate(list(pool.map(function, slices)))


def r2_sequence(count: int) -> Array:
    """Low-discrepancy points (count, 2) in the unit square: the R2 sequence (Roberts 2018)."""
    plastic = 1.32471795724474602596
    steps = np.arange(1, count + 1, dtype=np.float64)[:, None]
    return np.mod(0.5 + steps * np.array([1.0 / plastic, 1.0 / plastic**2]), 1.0).astype(np.float64)


def cosine_directions(normals: NDArray[Any], samples: NDArray[Any]) -> NDArray[Any]:
    """Cosine-weighted directions (N, 3) around normals (N, 3), from samples (N, 2) of the unit square."""
    radius, angle = np.sqrt(samples[:, :1]), 2.0 * np.pi * samples[:, 1:]
    # Orthonormal basis without branches (Duff et al. 2017).
    x, y, z = normals.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=1)
    height = np.sqrt(np.maximum(1.0 - radius**2, 0.0))
    return tangent * radius * np.cos(angle) + bitangent * radius * np.sin(angle) + normals * height
