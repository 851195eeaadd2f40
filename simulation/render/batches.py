"""A lit scene as arrays for drawing: one list of vertices, one of triangles, and batches that share a material."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array, Material, Part, welded
from edgemap.simulation.render.scene import ROOM_ID, LitPart, LitSurface

_GLOSS = 0.01
# Trim of the rooms is cut into pieces of about this size, so that what is out of view can be left out.
_CELL_M = 3.0

CORNERS = np.dtype(
    [
        ("position", "3f4"),
        ("uv", "2f4"),
        ("normal", "4i1"),
        ("tint", "4u1"),
        ("day_front", "3f2"),
        ("day_back", "3f2"),
        ("lamp_front", "3f2"),
        ("lamp_back", "3f2"),
    ]
)
SURFACES = np.dtype([("position", "3f4"), ("uv", "2f4"), ("normal", "4i1"), ("tint", "4u1"), ("map_uv", "2f4")])


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """One draw call: `count` indices from `first`. needs: of the shader, names of glsl/surface: IMAGE, HOLES, GLOSSY,
    and LIGHT_MAP where it is lit by a texture, not at its corners. corners: (8, 3) of its bounding box, metres."""

    id: int
    needs: frozenset[str]
    material: Material
    first: int
    count: int
    corners: Array


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """Vertices (structured), triangles (uint32 indices, three by three) and the batches they make."""

    vertices: NDArray[Any]
    indices: NDArray[np.uint32]
    batches: tuple[Batch, ...]


def pack_parts(parts: Sequence[LitPart]) -> Packed:
    """Parts of solids; those of one object that look alike are drawn in one go."""
    groups: dict[tuple[Any, ...], list[LitPart]] = {}
    for lit in parts:
        groups.setdefault(_drawn_alike(lit), []).append(lit)
    vertices, indices, batches, first = [], [], [], 0
    for group in groups.values():
        rows = np.concatenate([_corner_rows(lit) for lit in group])
        keep, inverse = welded(rows.view(np.uint8).reshape(len(rows), -1))
        material = group[0].part.material
        box = _box(rows["position"][keep])
        batches.append(Batch(group[0].id, _needs(material), material, first, len(rows), box))
        indices.append((inverse + sum(map(len, vertices))).astype(np.uint32))
        vertices.append(rows[keep])
        first += len(rows)
    return Packed(np.concatenate(vertices), np.concatenate(indices), tuple(batches))


def pack_surfaces(surfaces: Sequence[LitSurface], places: Sequence[Array]) -> Packed:
    """Surfaces with their light maps' places in the atlas: (u0, v0, u1, v1) of each map's border, 0..1."""
    vertices, batches = [], []
    for number, (lit, place) in enumerate(zip(surfaces, places, strict=True)):
        part = lit.surface.part()
        rows, share = _rows(part, SURFACES), part.uv.reshape(-1, 2) / part.uv.reshape(-1, 2).max(axis=0)
        rows["map_uv"] = place[:2] + share * (place[2:] - place[:2])
        vertices.append(rows)
        needs, box = _needs(part.material) | {"LIGHT_MAP"}, _box(part.positions.reshape(-1, 3))
        batches.append(Batch(ROOM_ID, needs, part.material, 6 * number, 6, box))
    return Packed(np.concatenate(vertices), np.arange(6 * len(surfaces), dtype=np.uint32), tuple(batches))


def _drawn_alike(lit: LitPart) -> tuple[Any, ...]:
    material = lit.part.material
    cell = ()
    if lit.id == ROOM_ID:
        cell = tuple(np.floor(lit.part.positions.reshape(-1, 3).mean(axis=0) / _CELL_M).astype(int))
    opacity = material.opacity if material.see_through else 1.0
    return lit.id, cell, id(material.texture), round(material.gloss, 2), opacity, material.emission, material.group


def _corner_rows(lit: LitPart) -> NDArray[Any]:
    rows = _rows(lit.part, CORNERS)
    for side, light in (("front", lit.front), ("back", lit.back)):
        rows[f"lamp_{side}"], rows[f"day_{side}"] = np.split(light.reshape(-1, 6), 2, axis=1)
    return rows


def _rows(part: Part, kind: np.dtype) -> NDArray[Any]:
    """A row for each corner of a part's triangles, still without light."""
    rows = np.zeros(3 * len(part.positions), kind)
    rows["position"], rows["uv"] = part.positions.reshape(-1, 3), part.uv.reshape(-1, 2)
    rows["normal"][:, :3] = np.round(part.normals.reshape(-1, 3) * 127.0)
    rows["tint"][:, :3] = np.round(255.0 * np.sqrt(np.clip(part.material.colour, 0.0, 1.0)))
    return rows


def _needs(material: Material) -> frozenset[str]:
    needs = {"IMAGE": material.texture is not None, "HOLES": material.cut_out, "GLOSSY": material.gloss > _GLOSS}
    return frozenset(name for name, needed in needs.items() if needed)


def _box(points: Array) -> Array:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array(list(product(*zip(low, high, strict=True))), dtype=np.float64)
