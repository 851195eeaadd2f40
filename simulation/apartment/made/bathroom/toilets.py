"""Toilets."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.finishes import china_of
from edgemap.simulation.apartment.made.materials.plain import BLACK, CHROME, drawn_colour, wood
from edgemap.simulation.apartment.made.shapes.bars import tube
from edgemap.simulation.apartment.made.shapes.lofts import loft
from edgemap.simulation.apartment.made.shapes.outlines import oval, raised, rectangle
from edgemap.simulation.apartment.made.shapes.placing import joined, leaned
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Array, Material, Mesh, box

_WATER = Material((0.35, 0.4, 0.42), gloss=0.6)


def toilet(rng: np.random.Generator) -> Mesh:
    """A bowl on a foot or hung on a box, with seat and lid, and a cistern behind it, or none to be seen."""
    china = china_of(rng)
    build = str(rng.choice(["close", "hung", "bare", "skirted"], p=[0.5, 0.2, 0.1, 0.2]))
    long, wide = float(rng.uniform(0.42, 0.52)), float(rng.uniform(0.34, 0.39))
    rim = float(rng.uniform(0.37, 0.43))
    outline = oval(long, wide, behind=float(rng.uniform(2.4, 3.6)), squareness=float(rng.uniform(1.8, 2.6)))
    # The bowl's middle is at x = 0, its back at -long / 2.
    back = -long / 2.0
    meshes = [_bowl(rng, china, outline, long, wide, rim, build)]
    rear = float(rng.uniform(0.1, 0.16))
    if build != "hung":
        deck = 0.08 if build == "close" else rim * 0.9
        deck_wide = wide * (0.45 if build == "close" else 0.85)
        if build == "close" and rng.random() < 0.5:
            deck_wide = wide * 0.7
        low = rim - deck if build == "close" else 0.0
        meshes.append(
            rounded((back - rear, -deck_wide / 2, low), (back + 0.05, deck_wide / 2, rim), china, 0.03, 0.012)
        )
    if build in {"close", "skirted"}:
        depth, tall = float(rng.uniform(0.15, 0.19)), float(rng.uniform(0.3, 0.42))
        across = float(rng.uniform(0.34, 0.46))
        meshes.append(_cistern(rng, china, back + 0.015, depth, across, rim - 0.005, tall))
    elif build == "hung":
        depth, tall = float(rng.uniform(0.13, 0.2)), float(rng.uniform(0.95, 1.2))
        across = float(rng.uniform(0.5, 1.0))
        box_ = china if rng.random() < 0.6 else (wood(rng) if rng.random() < 0.4 else Material(drawn_colour(rng, 0.08)))
        wall = back - 0.005
        meshes.append(box((wall - depth, -across / 2, 0.0), (wall, across / 2, tall), box_))
        meshes.append(
            box((wall - depth, -across / 2 - 0.008, tall), (wall + 0.012, across / 2 + 0.008, tall + 0.015), china)
        )
        button = CHROME if rng.random() < 0.5 else china
        z = min(rim + 0.45, tall - 0.2)
        meshes.append(rounded((wall - 0.01, -0.12, z), (wall + 0.008, 0.12, z + 0.16), button, 0.012, 0.004, axis=0))
        for y in (-0.055, 0.055):
            meshes.append(
                rounded((wall, y - 0.045, z + 0.03), (wall + 0.012, y + 0.045, z + 0.13), button, 0.01, 0.003, 0)
            )
    meshes.append(_seat(rng, china, outline, long, rim))
    return joined(meshes)


def _bowl(
    rng: np.random.Generator, china: Material, outline: Array, long: float, wide: float, rim: float, build: str
) -> Mesh:
    """Outside from the floor or the wall up to the rim, and the hollow down to the water."""
    back = -long / 2.0
    low = float(rng.uniform(0.06, 0.16)) if build == "hung" else 0.0
    foot_long, foot_wide = long * float(rng.uniform(0.75, 0.95)), wide * float(rng.uniform(0.55, 0.7))
    waist, waist_at = float(rng.uniform(0.62, 0.95)), float(rng.uniform(0.35, 0.55))
    if build == "skirted":
        foot_long, foot_wide, waist = long * 0.9, wide * float(rng.uniform(0.75, 0.88)), 1.0
    if build == "hung":
        foot_long, foot_wide, waist = long * 0.5, wide * 0.55, 1.2
    heights = np.array([0.0, 0.03, waist_at * 0.6, waist_at, 0.72, 0.86, 0.94, 0.985, 1.0])
    mix = np.array([0.0, 0.0, 0.06, 0.16, 0.55, 0.83, 0.96, 1.0, 0.985])
    pinch = np.interp(heights, [0.0, 0.05, waist_at, 0.75, 1.0], [1.0, 0.98, waist, 1.0, 1.0])
    x_lag = 0.0 if build == "hung" else float(rng.uniform(0.0, 0.03))
    rings = []
    for height, share, thin in zip(heights, mix, pinch, strict=True):
        depth = (foot_long + (long - foot_long) * share) * (0.5 + 0.5 * thin)
        width = (foot_wide + (wide - foot_wide) * share) * thin
        ring = outline / [long, wide] * [depth, width]
        shift = back + depth / 2.0 - x_lag * (1.0 - share)
        rings.append(raised(ring, shift, 0.0, low + height * (rim - low)))
    meshes = [loft(rings, china, high=False)]
    # Rim and hollow: ever smaller rings inwards and down.
    sizes, depths = [0.985, 0.9, 0.74, 0.7, 0.62, 0.45, 0.3], [0.0, 0.0, 0.0, 0.03, 0.1, 0.17, 0.2]
    inner = [raised(outline, 0.01 * (1 - s), 0.0, rim - d, s) for s, d in zip(sizes, depths, strict=True)]
    meshes.append(loft(inner[:3], china, low=False, high=False))
    meshes.append(loft(inner[2:], china, low=False, high=False))
    meshes.append(
        loft(
            [raised(outline, 0.0, 0.0, rim - 0.201, 0.3), raised(outline, 0.0, 0.0, rim - 0.16, 0.46)],
            _WATER,
            low=False,
        )
    )
    return joined(meshes)


def _cistern(
    rng: np.random.Generator, china: Material, face: float, depth: float, width: float, low: float, tall: float
) -> Mesh:
    """A tank that widens upwards, its lid, and a button on top or a lever in front."""
    taper, radius = float(rng.uniform(0.82, 1.0)), float(rng.uniform(0.015, 0.06))
    steps = [(0.0, 0.9), (0.03, 0.97), (0.06, 1.0), (0.5, 1.0), (1.0, 1.0)]
    rings = []
    for height, size in steps:
        across = width * (taper + (1.0 - taper) * height) * size
        deep = depth * (0.85 + 0.15 * height) * size
        rings.append(raised(rectangle(deep, across, radius), face - depth / 2.0, 0.0, low + height * (tall - 0.03)))
    lid = float(rng.uniform(0.006, 0.014))
    top = low + tall
    meshes = [
        loft(rings, china),
        rounded(
            (face - depth - lid, -width / 2 - lid, top - 0.035),
            (face + lid, width / 2 + lid, top),
            china,
            radius + lid,
            0.01,
        ),
    ]
    if rng.random() < 0.65:
        meshes.append(tube((face - depth / 2, 0, top - 0.002), (face - depth / 2, 0, top + 0.008), 0.026, CHROME))
    else:
        y, z, x = width * 0.36, top - 0.085, face - 0.012
        meshes.append(tube((x, y, z), (x + 0.022, y, z), 0.013, CHROME))
        meshes.append(tube((x + 0.022, y + 0.01, z), (x + 0.03, y - 0.075, z - 0.008), 0.007, CHROME))
    return joined(meshes)


def _seat(rng: np.random.Generator, china: Material, outline: Array, long: float, rim: float) -> Mesh:
    """Seat down with its lid down or up, or both up."""
    way = rng.random()
    material = china
    if rng.random() < 0.25:
        material = (wood(rng), BLACK, Material((0.75, 0.75, 0.74), gloss=0.4))[int(rng.integers(3))]
    thick, lift = float(rng.uniform(0.016, 0.026)), float(rng.uniform(0.004, 0.008))
    low, size = rim + lift, float(rng.uniform(1.0, 1.04))
    hinge = -long / 2.0 + 0.035
    meshes = [block(hinge, y, rim - 0.002, 0.03, 0.04, lift + thick, material) for y in (-0.075, 0.075)]

    def slab(bottom: float, tall: float) -> Mesh:
        heights, sizes = (0.0, 0.15, 0.7, 0.92, 1.0), (0.985, 1.0, 1.0, 0.98, 0.95)
        return loft(
            [raised(outline, 0.012, 0.0, bottom + tall * h, size * s) for h, s in zip(heights, sizes, strict=True)],
            material,
        )

    def ring(bottom: float) -> Mesh:
        rows = [
            (0.62, 0.0),
            (1.0, 0.0),
            (1.005, thick * 0.5),
            (0.98, thick),
            (0.66, thick),
            (0.62, thick * 0.6),
            (0.62, 0.0),
        ]
        rings = [raised(outline, 0.012, 0.0, bottom + h, size * s) for s, h in rows]
        return loft(rings, material, low=False, high=False)

    lean = float(rng.uniform(0.06, 0.2))
    if way < 0.55:
        return joined([*meshes, ring(low), slab(low + thick + 0.003, thick)])
    lifted = _tilted(slab(low, thick * 0.7), hinge, low, lean)
    if way < 0.85:
        return joined([*meshes, ring(low), lifted])
    return joined([*meshes, lifted, _tilted(ring(low + thick + 0.004), hinge, low, lean)])


def _tilted(mesh: Mesh, hinge: float, z: float, lean: float) -> Mesh:
    """What lay on the bowl, turned up about its hinge, a little short of upright or past it."""
    return leaned(mesh, np.pi / 2.0 - lean, (hinge - 0.01, 0.0, z)).placed(0.03, 0.0, 0.0, 0.0)
