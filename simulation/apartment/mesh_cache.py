"""Disk cache of simplified furniture meshes. Reading an OBJ file takes many times longer than reading the cache."""

import json
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.network.store import cache_folder
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, welded

# Increase it whenever `obj.py` or `simplified` give another result for the same file.
VERSION = 1
_ROWS = ("positions", "normals", "uv")


def kept(key: str, source: Path, most_triangles: int, make: Callable[[], Mesh]) -> Mesh:
    """Returns the mesh of `make`, bit for bit, from the cache `$EDGEMAP_CACHE/meshes`.

    key: identifies the model and names its file. source: the library file. `make` is called again if the size or time
    of the library has changed, or if the cached file is damaged. A read-only cache is not updated.
    """
    about = source.stat()
    stamp = np.array([VERSION, most_triangles, about.st_size, about.st_mtime_ns])
    path = cache_folder() / "meshes" / f"{key.replace('/', '-')}.npz"
    mesh = _read(path, stamp)
    if mesh is None:
        mesh = make()
        with suppress(OSError, DiskError):
            _write(path, stamp, mesh)
    return mesh


def _read(path: Path, stamp: NDArray[np.int64]) -> Mesh | None:
    """The cached mesh; None if the file is missing, damaged, or has another stamp."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            if not np.array_equal(arrays["stamp"], stamp):
                return None
            positions, normals, uv = (arrays[f"{name}_table"][arrays[f"{name}_rows"]] for name in _ROWS)
            textures = [arrays[f"texture_{number}"] for number in range(int(arrays["textures"]))]
            parts, first = [], 0
            for entry in json.loads(arrays["parts"].tobytes()):
                last = first + entry.pop("triangles")
                material = _material(entry, textures)
                parts.append(Part(material, positions[first:last], normals[first:last], uv[first:last]))
                first = last
            return Mesh(tuple(parts))
    except (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        return None


def _write(path: Path, stamp: NDArray[np.int64], mesh: Mesh) -> None:
    """Writes the file atomically, so that several processes may write it. Raises OSError or DiskError."""
    arrays: dict[str, NDArray] = {"stamp": stamp}
    for name in _ROWS:
        table, rows = _unique_rows(np.concatenate([getattr(part, name) for part in mesh.parts]))
        arrays |= {f"{name}_table": table, f"{name}_rows": rows}
    # Parts are drawn together only if they share one texture object, not if their textures are merely equal.
    textures = {id(image): image for part in mesh.parts if (image := part.material.texture) is not None}
    entries = []
    for part in mesh.parts:
        image = part.material.texture
        entry = asdict(replace(part.material, texture=None))
        entry["texture"] = None if image is None else list(textures).index(id(image))
        entries.append({**entry, "triangles": len(part.positions)})
    arrays |= {f"texture_{number}": image for number, image in enumerate(textures.values())}
    arrays |= {"textures": np.array(len(textures)), "parts": np.frombuffer(json.dumps(entries).encode(), np.uint8)}
    path.parent.mkdir(parents=True, exist_ok=True)
    packed = BytesIO()
    np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
    write_atomically(path, packed.getvalue())


def _unique_rows(corners: Array) -> tuple[Array, NDArray[np.uint32]]:
    """Splits rows (T, 3, n) into a table of distinct rows and the indices (T, 3) into this table."""
    rows = np.ascontiguousarray(corners).reshape(-1, corners.shape[2])
    keep, inverse = welded(rows.view(np.uint8).reshape(len(rows), -1))
    return rows[keep], inverse.astype(np.uint32).reshape(corners.shape[:2])


def _material(entry: dict[str, Any], textures: list[NDArray[np.uint8]]) -> Material:
    number = entry.pop("texture")
    values: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in entry.items()}
    return Material(texture=None if number is None else textures[number], **values)


_FINEST_M, _COARSEST_M, _GROWTH = 0.002, 0.03, 1.3


def simplified(mesh: Mesh, most: int) -> Mesh:
    """Simplifies a mesh to about `most` triangles or fewer, with the smallest possible cells (2 mm to 3 cm).

    Vertex clustering (Rossignac and Borrel, 1993). A vertex moves to the mean of its cell, and keeps its normal and its
    texture coordinates. A triangle is dropped if its area becomes zero or if it coincides with another one.
    """
    cell, result = _FINEST_M, mesh
    while sum(len(part.positions) for part in result.parts) > most and cell < _COARSEST_M:
        result = Mesh(tuple(_clustered(part, cell) for part in mesh.parts))
        cell *= _GROWTH
    return result


def _clustered(part: Part, cell_m: float) -> Part:
    points: Array = part.positions.reshape(-1, 3)
    keys = np.round(points / cell_m).astype(np.int64)
    keys -= keys.min(axis=0)
    # One number for each cell: sorting numbers is many times faster than sorting rows.
    _, cluster = np.unique((keys[:, 0] << 40) | (keys[:, 1] << 20) | keys[:, 2], return_inverse=True)
    count = np.bincount(cluster)
    means = np.stack([np.bincount(cluster, weights=points[:, axis]) / count for axis in range(3)], axis=1)
    corners = cluster.reshape(-1, 3)
    a, b, c = corners.T
    solid = np.flatnonzero((a != b) & (b != c) & (a != c))
    low, middle, high = np.sort(corners[solid], axis=1).T
    _, first = np.unique((low << 42) | (middle << 21) | high, return_index=True)
    keep = solid[np.sort(first)]
    if not len(keep):
        return part
    return Part(part.material, means[corners[keep]], part.normals[keep], part.uv[keep])
