"""Models of our own for what the libraries have too few of: vases turned on a lathe, trolley suitcases, televisions.

Their keys are `edgemap/vase-1` and so on: the number draws proportions and colours. No catalogue, no licence needed.
"""

from __future__ import annotations

import colorsys

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, box, quad

LIBRARY = "edgemap"
COUNTS = {"vase": 14, "suitcase": 10, "tv": 8}
_BLACK = Material((0.015, 0.015, 0.017), gloss=0.25)


def made(name: str) -> Mesh:
    """A model in metres, x out of its front, y left, z up, origin on the floor at its box's centre."""
    kind, number = name.split("-")
    rng = np.random.default_rng([sum(map(ord, kind)), int(number)])
    return _centred({"vase": _vase, "suitcase": _suitcase, "tv": _tv}[kind](rng))


def _colour(rng: np.random.Generator, saturation: float = 0.8) -> tuple[float, float, float]:
    value = float(rng.uniform(0.08, 0.75))
    return colorsys.hsv_to_rgb(float(rng.random()), float(rng.uniform(0.0, saturation)), value)


def _vase(rng: np.random.Generator) -> Mesh:
    """A turned body: foot, belly, neck and lip, glazed in one colour with or without a band."""
    height = float(rng.uniform(0.22, 0.55))
    belly, at = float(rng.uniform(0.2, 0.38)) * height, float(rng.uniform(0.3, 0.65))
    foot, neck = belly * float(rng.uniform(0.45, 0.8)), belly * float(rng.uniform(0.22, 0.6))
    lip = neck * float(rng.uniform(1.05, 1.5))
    radius = PchipInterpolator([0.0, at, float(rng.uniform(0.8, 0.9)), 1.0], [foot, belly, neck, lip])
    up = np.linspace(0.0, 1.0, 25)
    outer, inner = radius(up), np.maximum(radius(up[::-1]) - 0.006, 0.004)
    glaze = Material(_colour(rng), gloss=float(rng.uniform(0.1, 0.5)))
    parts = [_lathe(outer, up * height, glaze), _lathe(inner, up[::-1] * height, Material((0.03, 0.03, 0.03)))]
    if rng.random() < 0.5:
        low = float(rng.uniform(0.2, 0.6))
        band = np.linspace(low, low + float(rng.uniform(0.08, 0.25)), 9)
        parts.append(_lathe(radius(band) + 0.0015, band * height, Material(_colour(rng), gloss=0.3)))
    return Mesh(tuple(parts))


def _lathe(radii: Array, heights: Array, material: Material, sides: int = 28) -> Part:
    """A surface of revolution from a profile (N,), smooth all round; it faces outwards where the profile rises."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate(
        [radii[:, None, None] * around, np.broadcast_to(heights[:, None, None], (len(radii), sides + 1, 1))], axis=2
    )
    slope_r, slope_z = np.gradient(radii), np.gradient(heights)
    normals = np.concatenate(
        [slope_z[:, None, None] * around, np.broadcast_to(-slope_r[:, None, None], (len(radii), sides + 1, 1))], axis=2
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    a, b, c, d = (grid for grid in _corners(points))
    na, nb, nc, nd = (grid for grid in _corners(normals))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    shading = np.concatenate([np.stack([na, nb, nc], axis=1), np.stack([na, nc, nd], axis=1)])
    return Part(material, triangles, shading, np.zeros((*triangles.shape[:2], 2)))


def _corners(grid: Array) -> list[Array]:
    """The four corners of every cell of a grid (R, C, 3), counter-clockwise, each (cells, 3)."""
    return [part.reshape(-1, 3) for part in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1])]


def _suitcase(rng: np.random.Generator) -> Mesh:
    """An upright trolley: shell with ribs and rounded edges, seam, four wheels and a handle, drawn out or not."""
    width, height = float(rng.uniform(0.34, 0.48)), float(rng.uniform(0.5, 0.72))
    depth = width * float(rng.uniform(0.5, 0.62))
    shell = Material(_colour(rng, 0.9), gloss=float(rng.uniform(0.0, 0.35)))
    wheel, round_ = 0.05, 0.035
    low, high = np.array([-depth / 2, -width / 2, wheel]), np.array([depth / 2, width / 2, wheel + height])
    meshes = [
        box(low + np.roll([0.0, round_, round_], axis), high - np.roll([0.0, round_, round_], axis), shell)
        for axis in range(3)
    ]
    inset = round_ * 0.3
    meshes.append(box(low + inset, high - inset, shell))
    meshes.append(box(low + [depth / 2 - 0.006, -0.002, -0.002], high - [depth / 2 - 0.006, -0.002, -0.002], _BLACK))
    ribs = int(rng.integers(0, 7))
    for y in np.linspace(-width / 2 + 0.07, width / 2 - 0.07, ribs) if ribs > 1 else []:
        for x in (low[0] - 0.006, high[0] - 0.002):
            meshes.append(box((x, y - 0.012, wheel + 0.06), (x + 0.008, y + 0.012, wheel + height - 0.06), shell))
    for x in (low[0] + 0.05, high[0] - 0.05):
        for y in (low[1] + 0.05, high[1] - 0.05):
            meshes.append(box((x - 0.022, y - 0.014, 0.0), (x + 0.022, y + 0.014, wheel + 0.02), _BLACK))
    meshes.append(box((-0.012, -0.08, wheel + height), (0.012, 0.08, wheel + height + 0.025), _BLACK))
    if rng.random() < 0.5:
        top, back = wheel + height + float(rng.uniform(0.25, 0.42)), low[0] + 0.03
        steel = Material((0.45, 0.45, 0.46), gloss=0.5)
        for y in (-0.09, 0.09):
            meshes.append(box((back - 0.008, y - 0.008, wheel + height - 0.02), (back + 0.008, y + 0.008, top), steel))
        meshes.append(box((back - 0.014, -0.105, top), (back + 0.014, 0.105, top + 0.03), _BLACK))
    return _joined(meshes)


def _tv(rng: np.random.Generator) -> Mesh:
    """A flat screen on a foot or two, dark or showing something."""
    width = float(rng.uniform(0.6, 1.15))
    height, lift = width * 0.57, float(rng.uniform(0.04, 0.1))
    case = Material((0.35, 0.35, 0.36), gloss=0.3) if rng.random() < 0.2 else _BLACK
    rim = float(rng.uniform(0.012, 0.03))
    meshes = [box((-0.025, -width / 2, lift), (0.022, width / 2, lift + height), case)]
    screen = _BLACK if rng.random() < 0.6 else Material(_colour(rng, 0.5))
    u, v = np.array([0.0, width - 2 * rim, 0.0]), np.array([0.0, 0.0, height - 2 * rim])
    face = quad(np.array([0.0235, -width / 2 + rim, lift + rim]), u, v, Material(screen.colour, gloss=0.5))
    meshes.append(Mesh((face,)))
    if rng.random() < 0.5:
        meshes += [box((-0.03, -0.04, 0.0), (0.0, 0.04, lift), case), box((-0.1, -0.2, 0.0), (0.1, 0.2, 0.012), case)]
    else:
        for y in (-width * 0.35, width * 0.35):
            meshes.append(box((-0.1, y - 0.015, 0.0), (0.1, y + 0.015, lift), case))
    return _joined(meshes)


def _joined(meshes: list[Mesh]) -> Mesh:
    return Mesh(tuple(part for mesh in meshes for part in mesh.parts))


def _centred(mesh: Mesh) -> Mesh:
    points = mesh.triangles().reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    shift = -np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    return Mesh(tuple(part.moved(np.eye(3), shift) for part in mesh.parts))
