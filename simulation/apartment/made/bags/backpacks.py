"""Backpacks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import bag_cloth
from edgemap.simulation.apartment.made.materials.plain import BLACK, STEEL, drawn_colour
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import loft
from edgemap.simulation.apartment.made.shapes.outlines import arc, oval, raised
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, cushion
from edgemap.simulation.render.mesh import Material, Mesh

# Depth, width, middle x and middle y of a bag at a share of its height.
Ring = Callable[[float], tuple[float, float, float, float]]
ZIP = Material((0.02, 0.02, 0.022), gloss=0.15)


def backpack(rng: np.random.Generator) -> Mesh:
    """A bag of cloth that stands on the floor, pockets to the front, two straps behind, a loop on top."""
    build = str(rng.choice(["school", "laptop", "hiking", "flap"], p=[0.4, 0.2, 0.22, 0.18]))
    height = float(rng.uniform(0.55, 0.72)) if build == "hiking" else float(rng.uniform(0.38, 0.52))
    width = float(rng.uniform(0.27, 0.35))
    depth = float(rng.uniform(0.13, 0.18)) if build == "laptop" else float(rng.uniform(0.16, 0.25))
    cloth, second = bag_cloth(rng), bag_cloth(rng) if rng.random() < 0.55 else None
    second = second or cloth
    strap = BLACK if rng.random() < 0.6 else Material(drawn_colour(rng, 0.8))
    dome = {"laptop": 0.12, "flap": 0.1, "hiking": 0.14}.get(build, float(rng.uniform(0.16, 0.3)))
    outline = oval(1.0, 1.0, behind=float(rng.uniform(5.0, 8.0)), squareness=float(rng.uniform(2.6, 4.5)))
    slouch, lean = float(rng.uniform(-0.02, 0.03)), float(rng.uniform(-0.02, 0.1))
    skew = float(rng.normal(0.0, 0.015))

    def ring(share: float) -> tuple[float, float, float, float]:
        """Depth, width, middle x and middle y of the bag at a share of its height."""
        belly = 1.0 - 0.3 * max(share - 0.3, 0.0) ** 1.3 - 0.08 * (share < 0.03)
        top = np.sqrt(max(1.0 - max(share - (1.0 - dome), 0.0) ** 2 / dome**2, 0.0)) if share < 1 else 0.0
        d, w = depth * belly * max(top, 0.25), width * (1.0 - 0.1 * share) * max(top**0.8, 0.3)
        x = -depth / 2.0 + depth * belly / 2.0 - lean * share * height + slouch * np.sin(np.pi * share)
        return d, w, x, skew * np.sin(np.pi * share)

    shares = np.concatenate([[0.0, 0.015, 0.05, 0.15, 0.3, 0.5], np.linspace(0.65, 0.999, 8)])
    rings = []
    for share in shares:
        d, w, x, y = ring(float(share))
        size = 0.9 if share == 0.0 else 0.97 if share < 0.02 else 1.0
        rings.append(raised(outline * [d * size, w * size], x, y, share * height))
    meshes = [loft(rings, cloth)]
    meshes += _straps(rng, ring, height, width, strap, build)
    meshes += _pockets(rng, ring, height, width, second, build)
    if build in {"hiking", "flap"}:
        meshes += _lid(rng, ring, height, depth, width, second, strap, build)
    else:
        meshes += _zips(rng, ring, height, dome)
    d, _, x, y = ring(0.995)
    top = height + (0.03 if build in {"hiking", "flap"} else 0.0)
    loop = arc(
        (x - d * 0.5, y - 0.05, top - 0.02),
        (x - d * 0.5, y + 0.05, top - 0.02),
        (0.0, 0.0, float(rng.uniform(0.04, 0.07))),
    )
    meshes.append(rod(loop, 0.013, strap, 0.004 / 0.013, across=(1.0, 0.0, 0.0)))
    return joined(meshes)


def _straps(
    rng: np.random.Generator, ring: Ring, height: float, width: float, strap: Material, build: str
) -> list[Mesh]:
    """Two padded straps behind, and a belt where the bag is for hiking."""
    away, wide = float(rng.uniform(0.04, 0.09)), float(rng.uniform(0.022, 0.032))
    meshes = []
    d1, _, x1, _ = ring(0.86)
    d0, _, x0, _ = ring(0.08)
    for side in (-1.0, 1.0):
        sag = away * float(rng.uniform(0.8, 1.2))
        start = np.array([x1 - d1 / 2 + 0.006, side * width * 0.14, height * 0.87])
        end = np.array([x0 - d0 / 2 + 0.012, side * width * 0.36, height * 0.07])
        points = arc(end, start, (-sag, side * 0.01, height * 0.06), 13)
        meshes.append(rod(points, wide, strap, 0.006 / wide, across=(0.0, 1.0, side * 0.25)))
    if build == "hiking" and rng.random() < 0.8:
        d, w, x, _ = ring(0.14)
        for side in (-1.0, 1.0):
            belt = arc(
                (x - d * 0.45, side * w * 0.3, height * 0.14),
                (x + d * 0.1, side * (w * 0.52 + 0.02), height * 0.12),
                (-0.04, side * 0.05, 0.0),
            )
            meshes.append(rod(belt, 0.035, strap, 0.008 / 0.035, across=(0.0, 0.0, 1.0)))
    return meshes


def _pockets(
    rng: np.random.Generator, ring: Ring, height: float, width: float, cloth: Material, build: str
) -> list[Mesh]:
    """One or two pockets in front with their zips, and others at the sides, with or without a bottle."""
    meshes = []
    count = int(rng.integers(1, 3)) if build != "laptop" else int(rng.integers(0, 2))
    spans = {1: [(0.06, float(rng.uniform(0.4, 0.56)))], 2: [(0.05, 0.36), (0.42, 0.68)]}.get(count, [])
    for low, high in spans:
        d, w, x, y = ring((low + high) / 2.0)
        thick = float(rng.uniform(0.05, 0.09))
        wide = min(w * float(rng.uniform(0.66, 0.84)), width)
        middle = np.array([x + d / 2 - thick * 0.12, y, (low + high) / 2.0 * height])
        meshes.append(cushion(middle, (thick, wide, (high - low) * height), cloth, float(rng.uniform(3.5, 6.0))))
        z = middle[2] + (high - low) * height * 0.3
        if rng.random() < 0.8:
            meshes.append(block(middle[0] + thick * 0.47, y, z, 0.012, wide * 0.76, 0.009, ZIP))
            meshes.append(block(middle[0] + thick * 0.53, y + wide * 0.25, z - 0.025, 0.004, 0.007, 0.028, STEEL))
        if rng.random() < 0.3:
            badge = Material(drawn_colour(rng, 0.9))
            meshes.append(block(middle[0] + thick * 0.49, y, z - 0.06, 0.008, 0.06, 0.03, badge))
        if rng.random() < 0.25:
            light = Material((0.7, 0.7, 0.68), gloss=0.3)
            meshes.append(block(middle[0] + thick * 0.485, y, low * height + 0.035, 0.008, wide * 0.6, 0.012, light))
    if rng.random() < 0.65:
        d, w, x, y = ring(0.2)
        tall = height * float(rng.uniform(0.28, 0.4))
        for side in (-1.0, 1.0):
            middle = (x, y + side * w * 0.47, tall / 2.0 + 0.015)
            meshes.append(cushion(middle, (d * 0.62, 0.065, tall), cloth, 4.5))
        if rng.random() < 0.35:
            bottle = Material(drawn_colour(rng, 0.9), gloss=0.4)
            foot, head = (x, y + w * 0.5, 0.04), (x, y + w * 0.5, tall + 0.07)
            meshes += [tube(foot, head, 0.033, bottle), tube(head, np.add(head, (0, 0, 0.025)), 0.02, BLACK)]
    return meshes


def _zips(rng: np.random.Generator, ring: Ring, height: float, dome: float) -> list[Mesh]:
    """The main zip: an arch over the bag from side to side, its two ends low."""
    at_x, low = float(rng.uniform(-0.05, 0.2)), float(rng.uniform(0.3, 0.6))
    line = []
    for share in np.linspace(low, 0.985, 14):
        d, w, x, y = ring(float(share))
        line.append((x + d * at_x, y - w / 2 - 0.0005, share * height))
    line = np.array(line)
    d, w, x, y = ring(0.999)
    crown = np.array([(x + d * at_x, y + w * s, height + 0.0005) for s in (-0.3, 0.0, 0.3)])
    other = line[::-1].copy()
    other[:, 1] = [2 * ring(float(z / height))[3] - v for v, z in zip(other[:, 1], other[:, 2], strict=True)]
    return (
        [rod(np.concatenate([line, crown, other]), 0.007, ZIP, 0.003 / 0.007, across=(1.0, 0.0, 0.0))] if dome else []
    )


def _lid(
    rng: np.random.Generator,
    ring: Ring,
    height: float,
    depth: float,
    width: float,
    cloth: Material,
    strap: Material,
    build: str,
) -> list[Mesh]:
    """A lid over the top, held in front by one or two straps; on hiking bags ties at the sides, and a mat."""
    d, _, x, y = ring(0.9)
    meshes = [cushion((x + 0.015, y, height - 0.005), (d + 0.08, width * 0.95, height * 0.16), cloth, 3.6)]
    lean = np.array([1.0, 0.0, 0.0])
    front = []
    for share in (0.93, 0.8, 0.65, 0.5, 0.4):
        d, _, x, _ = ring(share)
        front.append(np.array([x + d / 2 + (0.05 if share > 0.7 else 0.03), 0.0, share * height]))
    if build == "flap":
        points = np.array([front[0] - 0.05 * lean + [0, 0, 0.02], *front[:4]])
        meshes.append(rod(points, width * 0.46, cloth, 0.006 / (width * 0.46), across=(0.0, 1.0, 0.0)))
    count = int(rng.integers(1, 3))
    for offset in [0.0] if count == 1 else [-width * 0.22, width * 0.22]:
        points = np.array(front) + [0.009, y + offset, 0.0]
        meshes.append(rod(points, 0.012, strap, 0.003 / 0.012, across=(0.0, 1.0, 0.0)))
        meshes.append(
            block(points[3][0], y + offset, points[3][2], 0.02, 0.036, 0.028, STEEL if rng.random() < 0.5 else BLACK)
        )
    if build == "hiking" and rng.random() < 0.5:
        mat = Material(drawn_colour(rng, 0.8))
        if rng.random() < 0.5:
            z, x = height * 1.08 + 0.05, ring(0.9)[2]
        else:
            z, x = 0.085, ring(0.1)[2] + depth / 2 + 0.07
        meshes.append(tube((x, -width * 0.65, z), (x, width * 0.65, z), 0.065, mat))
        for side in (-width * 0.35, width * 0.35):
            meshes.append(tube((x, side - 0.01, z), (x, side + 0.01, z), 0.067, strap))
    return meshes
