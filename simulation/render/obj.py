"""Wavefront OBJ and MTL files out of a zip archive, as far as furniture models use them; and simpler meshes of them."""

import io
import posixpath
import zipfile
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

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
    parts = (_part(vertices, coordinates, normals, face, materials.get(name)) for name, face in faces.items())
    return [part for part in parts if part is not None]


def _parse(
    archive: zipfile.ZipFile, path: str
) -> tuple[Array, Array, Array, dict[str, np.ndarray], dict[str, Material]]:
    """Vertices, texture coordinates, normals, faces per material (T, 3, 3) of indices (-1 absent), materials."""
    rows: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": []}
    faces: dict[str, list[int]] = {}  # corners of triangles, numbered
    corners, numbers = list[tuple[int, ...]](), dict[str, int]()
    materials: dict[str, Material] = {}
    current = ""
    for line in archive.read(path).decode("latin1").splitlines():
        words = line.split() or [""]
        if words[0] in rows:
            rows[words[0]].append([float(word) for word in words[1:4]])
        elif words[0] == "usemtl":
            current = " ".join(words[1:])
        elif words[0] == "mtllib":
            materials |= _read_mtl(archive, posixpath.join(posixpath.dirname(path), " ".join(words[1:])))
        elif words[0] == "f":
            for word in words[1:]:
                if word not in numbers:
                    numbers[word] = len(corners)
                    corners.append(_corner(word))
            first, *rest = (numbers[word] for word in words[1:])
            fan = faces.setdefault(current, [])
            for pair in pairwise(rest):
                fan += (first, *pair)
    coordinates = np.array([row[:2] for row in rows["vt"]] or [[0.0, 0.0]])
    normals = np.array(rows["vn"] or [[0.0, 1.0, 0.0]])
    table = np.array(corners, dtype=np.int64)
    indices = {name: table[np.reshape(numbered, (-1, 3))] for name, numbered in faces.items() if numbered}
    return np.array(rows["v"]), coordinates, normals, indices, materials


def _corner(word: str) -> tuple[int, ...]:
    """`v/vt/vn` as zero-based indices, -1 where absent. Numbers that count from the end are in none of the models."""
    numbers = [int(text) - 1 for text in word.replace("//", "/0/").split("/")]
    return (*numbers, -1, -1)[:3]


def _part(
    vertices: Array, coordinates: Array, normals: Array, face: np.ndarray, material: Material | None
) -> Part | None:
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
    return Part(material or Material(), corners[..., _REP103], shading[..., _REP103], uv)


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
    except KeyError:  # some models name a file that is not there
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
    plain = srgb_to_linear([float(word) for word in entry.get("Kd", ["0.8"] * 3)[:3]])
    colour = tuple(plain.tolist()) if texture is None else (1.0, 1.0, 1.0)
    opacity = float(entry["d"][-1]) if "d" in entry else 1.0
    highlight = float(np.mean([float(word) for word in entry.get("Ks", ["0"])[:3]]))
    return Material(colour, texture, opacity, gloss=min(highlight, 1.0) * 0.5)


def _texture(archive: zipfile.ZipFile, path: str) -> np.ndarray | None:
    """RGBA uint8 texture, sides at most 512 px; None where the archive lacks the file. Names ignore case."""
    names = {name.lower(): name for name in archive.namelist()}
    found = names.get(posixpath.normpath(path).lower())
    if found is None:
        return None
    from PIL import Image

    image = Image.open(io.BytesIO(archive.read(found))).convert("RGBA")
    image.thumbnail((_LARGEST_TEXTURE_PX, _LARGEST_TEXTURE_PX))
    return np.asarray(image, dtype=np.uint8)


_FINEST_M, _COARSEST_M, _GROWTH = 0.002, 0.03, 1.3


def simplified(mesh: Mesh, most: int) -> Mesh:
    """Simplifies a mesh to about `most` triangles or fewer, with the smallest possible cells (2 mm to 3 cm).

    Vertex clustering (Rossignac and Borrel, 1993). A vertex moves to the mean of its cell, and keeps its normal and its
    texture coordinates. A triangle is dropped if its area becomes zero or if it coincides with another one.
    """
    cell, result = _FINEST_M, mesh
    while sum(len(part.positions) for part in result) > most and cell < _COARSEST_M:
        result = [_clustered(part, cell) for part in mesh]
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
