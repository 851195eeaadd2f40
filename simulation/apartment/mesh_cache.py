"""Furniture as it was read and simplified, kept on disk: to read an OBJ file again takes many times longer."""

import json
import os
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.network.store import cache_folder
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, welded

# To be raised whenever `obj.py` or `simplify.py` make something else of the same file.
_VERSION = 1
_ROWS = ("positions", "normals", "uv")


def kept(key: str, source: Path, most_triangles: int, make: Callable[[], Mesh]) -> Mesh:
    """The mesh of `make`, bit for bit, from the cache `$EDGEMAP_CACHE/meshes`. key: of the model, which names its file.
    source: its library; a change of its size or time, or a damaged file, makes the mesh again. A read-only cache is not
    updated.
    """
    about = source.stat()
    stamp = np.array([_VERSION, most_triangles, about.st_size, about.st_mtime_ns])
    path = cache_folder() / "meshes" / f"{key.replace('/', '-')}.npz"
    mesh = _read(path, stamp)
    if mesh is None:
        mesh = make()
        with suppress(OSError):
            _write(path, stamp, mesh)
    return mesh


def _read(path: Path, stamp: NDArray[np.int64]) -> Mesh | None:
    """None where there is no such file, or not a whole one, or one of something else."""
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
    """Write the file whole or not at all, whoever else writes it. Raises OSError."""
    arrays: dict[str, NDArray] = {"stamp": stamp}
    for name in _ROWS:
        table, rows = _told_once(np.concatenate([getattr(part, name) for part in mesh.parts]))
        arrays |= {f"{name}_table": table, f"{name}_rows": rows}
    # Parts are drawn together where they share one texture, and not where theirs only look alike.
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
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        with unfinished.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _told_once(corners: Array) -> tuple[Array, NDArray[np.uint32]]:
    """A table of unlike rows, and (T, 3) which of them stands where, from the rows (T, 3, n) themselves."""
    rows = np.ascontiguousarray(corners).reshape(-1, corners.shape[2])
    keep, inverse = welded(rows.view(np.uint8).reshape(len(rows), -1))
    return rows[keep], inverse.astype(np.uint32).reshape(corners.shape[:2])


def _material(entry: dict[str, Any], textures: list[NDArray[np.uint8]]) -> Material:
    number = entry.pop("texture")
    values: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in entry.items()}
    return Material(texture=None if number is None else textures[number], **values)
