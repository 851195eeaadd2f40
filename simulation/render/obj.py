"""Wavefront OBJ and MTL files out of a zip archive, as far as furniture models use them."""

import io
import posixpath
import zipfile
from collections.abc import Sequence

import numpy as np

from edgemap.simulation.errors import require
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, srgb_to_linear

_LARGEST_TEXTURE_PX = 512
# Sweet Home 3D: x to a viewer's right, y up, z out of the front. REP-103: x out of the front, y left, z up.
_REP103 = [2, 0, 1]


def read_obj(
    archive: zipfile.ZipFile, path: str, rotation: Sequence[float], size_m: tuple[float, float, float]
) -> Mesh:
    """Read one OBJ, turn it by the catalogue's rotation (row-major 3x3) and scale its box to (width, height, depth).

    Returns a mesh in metres, x out of the front, y left, z up, origin on the floor at the box's centre.
    """
    vertices, coordinates, normals, faces, materials = _parse(archive, path)
    turn = np.array(rotation).reshape(3, 3)
    vertices, normals = vertices @ turn.T, normals @ turn.T
    used = np.unique(np.concatenate([face[..., 0].ravel() for face in faces.values()]))
    low, high = vertices[used].min(axis=0), vertices[used].max(axis=0)
    scale = np.array(size_m) / np.maximum(high - low, 1e-9)
    vertices = (vertices - (low + high) / 2.0) * scale + [0.0, size_m[1] / 2.0, 0.0]
    normals = normals / scale
    parts = []
    for name, face in faces.items():
        part = _part(vertices, coordinates, normals, face, materials.get(name, Material()))
        if part is not None:
            parts.append(part)
    return Mesh(tuple(parts))


def _parse(
    archive: zipfile.ZipFile, path: str
) -> tuple[Array, Array, Array, dict[str, np.ndarray], dict[str, Material]]:
    """Vertices, texture coordinates, normals, faces per material (T, 3, 3) of indices (-1 absent), materials."""
    rows: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": []}
    faces: dict[str, list[list[tuple[int, int, int]]]] = {}
    materials: dict[str, Material] = {}
    current = ""
    for line in archive.read(path).decode("latin1").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] in rows:
            rows[words[0]].append([float(word) for word in words[1:4]])
        elif words[0] == "usemtl":
            current = " ".join(words[1:])
        elif words[0] == "mtllib":
            materials |= _read_mtl(archive, posixpath.join(posixpath.dirname(path), " ".join(words[1:])))
        elif words[0] == "f":
            corners = [_corner(word, rows) for word in words[1:]]
            fan = faces.setdefault(current, [])
            fan.extend([corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1))
    coordinates = np.array([row[:2] for row in rows["vt"]] or [[0.0, 0.0]])
    normals = np.array(rows["vn"] or [[0.0, 1.0, 0.0]])
    indices = {name: np.array(face, dtype=np.int64).reshape(-1, 3, 3) for name, face in faces.items() if face}
    return np.array(rows["v"]), coordinates, normals, indices, materials


def _corner(word: str, rows: dict[str, list[list[float]]]) -> tuple[int, int, int]:
    """`v/vt/vn` as zero-based indices, -1 where absent; negative numbers count from the end, as the format allows."""
    fields = (word.split("/") + ["", ""])[:3]
    found = []
    for text, kind in zip(fields, ("v", "vt", "vn"), strict=True):
        number = int(text) if text else 0
        found.append(number - 1 if number >= 0 else len(rows[kind]) + number)
    return found[0], found[1], found[2]


def _part(vertices: Array, coordinates: Array, normals: Array, face: np.ndarray, material: Material) -> Part | None:
    """Triangles of one material, those without area left out; where the file has no normals, made from the faces."""
    corners = vertices[face[..., 0]]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(flat, axis=1)
    solid = area > 1e-10
    if not solid.any():
        return None
    corners, face, flat = corners[solid], face[solid], flat[solid] / area[solid, None]
    shading = _smoothed(face[..., 0], flat)
    if (face[..., 2] >= 0).all():
        given = normals[face[..., 2]]
        length = np.linalg.norm(given, axis=2, keepdims=True)
        shading = np.where(length > 1e-9, given / np.maximum(length, 1e-9), shading)
    uv = coordinates[face[..., 1]] if (face[..., 1] >= 0).all() else np.zeros((*face.shape[:2], 2))
    return Part(material, corners[..., _REP103], shading[..., _REP103], uv)


def _smoothed(corners: np.ndarray, flat: Array) -> Array:
    """Corner normals (T, 3, 3) from face normals (T, 3): the mean over faces that share the vertex (T, 3), kept flat
    where that mean is more than 40 degrees off the face, so that edges stay sharp."""
    total = np.zeros((int(corners.max()) + 1, 3))
    np.add.at(total, corners, np.repeat(flat[:, None], 3, axis=1))
    mean = total[corners]
    mean /= np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1e-9)
    soft = (mean * flat[:, None]).sum(axis=2, keepdims=True) > np.cos(np.radians(40.0))
    return np.where(soft, mean, flat[:, None])


def _read_mtl(archive: zipfile.ZipFile, path: str) -> dict[str, Material]:
    try:
        text = archive.read(posixpath.normpath(path)).decode("latin1")
    except KeyError:
        return {}
    entries: dict[str, dict[str, list[str]]] = {}
    current: dict[str, list[str]] = {}
    for line in text.splitlines():
        words = line.split()
        if words and words[0] == "newmtl":
            current = entries.setdefault(" ".join(words[1:]), {})
        elif words:
            current[words[0]] = words[1:]
    return {name: _material(archive, posixpath.dirname(path), entry) for name, entry in entries.items()}


def _material(archive: zipfile.ZipFile, folder: str, entry: dict[str, list[str]]) -> Material:
    texture = _texture(archive, posixpath.join(folder, entry["map_Kd"][-1])) if entry.get("map_Kd") else None
    red, green, blue = srgb_to_linear([float(word) for word in entry.get("Kd", ["0.8"] * 3)[:3]])
    colour = (1.0, 1.0, 1.0) if texture is not None else (float(red), float(green), float(blue))
    opacity = float(entry["d"][-1]) if "d" in entry else 1.0
    highlight = float(np.mean([float(word) for word in entry.get("Ks", ["0"])[:3]]))
    return Material(colour, texture, opacity, gloss=min(highlight, 1.0) * 0.5)


def _texture(archive: zipfile.ZipFile, path: str) -> np.ndarray | None:
    """RGBA uint8 texture, sides at most 512 px; None where the archive lacks the file. Names ignore case."""
    names = {name.lower(): name for name in archive.namelist()}
    found = names.get(posixpath.normpath(path).lower())
    if found is None:
        return None
    image = require("PIL.Image").open(io.BytesIO(archive.read(found))).convert("RGBA")
    image.thumbnail((_LARGEST_TEXTURE_PX, _LARGEST_TEXTURE_PX))
    return np.asarray(image, dtype=np.uint8)
