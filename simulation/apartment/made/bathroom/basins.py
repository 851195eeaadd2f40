"""Washbasins."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.finishes import china_of
from edgemap.simulation.apartment.made.materials.plain import BLACK, BRASS, CHROME, wood
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import loft
from edgemap.simulation.apartment.made.shapes.outlines import arc, oval, raised, rectangle
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Array, Material, Mesh


def basin(rng: np.random.Generator) -> Mesh:
    """A washbasin on a pedestal, a column, legs, a small table, or on its waste pipe alone, with a tap."""
    china = china_of(rng)
    build = str(rng.choice(["pedestal", "legs", "column", "table", "pipe"], p=[0.45, 0.17, 0.13, 0.13, 0.12]))
    width, height = float(rng.uniform(0.42, 0.68)), float(rng.uniform(0.78, 0.88))
    depth = width * float(rng.uniform(0.68, 0.88))
    square = rng.random() < 0.35
    if build in {"column", "table"}:
        width = float(rng.uniform(0.38, 0.5))
        depth = width * (1.0 if build == "column" or rng.random() < 0.5 else 0.8)
    if square:
        outline = rectangle(depth, width, float(rng.uniform(0.02, 0.08)), steps=7)
    else:
        outline = oval(depth, width, behind=float(rng.uniform(2.0, 5.0)), squareness=float(rng.uniform(2.0, 3.0)))
    meshes, deck = [], 0.0
    if build == "table":
        top, tall = height - 0.13, 0.13
        slab_wide, slab_deep = width + float(rng.uniform(0.1, 0.35)), depth + 0.12
        plank = wood(rng)
        meshes.append(
            rounded(
                (-slab_deep / 2, -slab_wide / 2, top - 0.04), (slab_deep / 2, slab_wide / 2, top), plank, 0.01, 0.003
            )
        )
        meshes += _legs(rng, slab_deep * 0.9, slab_wide * 0.92, top - 0.02)
        meshes.append(_hollow(china, outline, height, tall, float(rng.uniform(0.5, 0.75)), 0.0))
        deck = top
        meshes.append(_tap(rng, -slab_deep / 2 + 0.045, deck, 0.13 + float(rng.uniform(0.06, 0.14)), depth * 0.55))
        return joined(meshes)
    tall = float(rng.uniform(0.13, 0.2))
    if build == "column":
        foot = float(rng.uniform(0.55, 0.95))
        shares = np.array([0.0, 0.02, 0.4, 0.75, 0.97, 1.0])
        bend = float(rng.uniform(0.7, 2.5))
        sizes = foot + (1.0 - foot) * shares**bend
        meshes.append(
            loft(
                [raised(outline, 0.0, 0.0, height * s, z) for s, z in zip(shares, sizes, strict=True)],
                china,
                high=False,
            )
        )
        meshes.append(_inside(china, outline, height, tall * 0.7, 0.02 / depth))
    else:
        meshes.append(_hollow(china, outline, height, tall, float(rng.uniform(0.35, 0.6)), depth * 0.06))
        if build == "pedestal":
            meshes.append(_pedestal(rng, china, -depth * 0.12, height - tall * 0.75, width))
        elif build == "legs":
            meshes += _legs(rng, depth * 0.82, width * 0.86, height - tall * 0.35)
            meshes += _drain(-depth * 0.05, height - tall, False)
        else:
            meshes += _drain(-depth * 0.05, height - tall, True)
    back = rng.random() < 0.35 and build != "column"
    if back:
        rise = float(rng.uniform(0.03, 0.1))
        span = width * (0.96 if square else 0.72)
        meshes.append(
            rounded(
                (-depth / 2, -span / 2, height - 0.05),
                (-depth / 2 + 0.03, span / 2, height + rise),
                china,
                0.02,
                0.008,
                0,
            )
        )
    meshes.append(_tap(rng, -depth / 2 + 0.055, height - 0.003, float(rng.uniform(0.08, 0.2)), depth * 0.35))
    return joined(meshes)


def _hollow(china: Material, outline: Array, height: float, tall: float, bottom: float, shift: float) -> Mesh:
    """A bowl open above: rounded outside that narrows to `bottom` of its size below, rim, inside."""
    shares = np.linspace(0.0, 0.78, 7)
    sizes = bottom + (1.0 - bottom) * np.sin(shares / 0.78 * np.pi / 2.0) ** 0.8
    rows = [*zip(shares, sizes, strict=True), (0.9, 1.005), (0.97, 1.005), (1.0, 0.99)]
    outside = loft(
        [raised(outline, -shift * (1.0 - s), 0.0, height - tall * (1.0 - s), z) for s, z in rows], china, high=False
    )
    return joined([outside, _inside(china, outline, height, tall * 0.8, 0.09 if shift else 0.04)])


def _inside(china: Material, outline: Array, height: float, deep: float, rim: float) -> Mesh:
    """Rim and hollow of a basin; behind the hollow room for a tap where the rim is wide."""
    forward = rim * 0.32
    edge = raised(outline, 0.0, 0.0, height, 0.99)
    parts = [(1.0, 0.0), (0.96, 0.2), (0.85, 0.6), (0.6, 0.9), (0.12, 1.0)]
    size = 1.0 - 2.0 * rim
    depth = np.ptp(outline[:, 0])
    inner = [
        raised(
            outline * [size * s - (rim if rim > 0.06 else 0.0) * s, size * s], forward * depth, 0.0, height - deep * d
        )
        for s, d in parts
    ]
    drain = tube((forward * depth, 0.0, height - deep), (forward * depth, 0.0, height - deep + 0.004), 0.022, CHROME)
    return joined([loft([edge, inner[0]], china, low=False, high=False), loft(inner, china, low=False), drain])


def _pedestal(rng: np.random.Generator, china: Material, x: float, top: float, width: float) -> Mesh:
    """A turned or square column that spreads at its foot and under the bowl."""
    waist, foot = width * float(rng.uniform(0.17, 0.3)), width * float(rng.uniform(0.3, 0.46))
    head = width * float(rng.uniform(0.3, 0.5))
    shares = np.array([0.0, 0.02, 0.06, 0.15, 0.35, 0.6, 0.85, 1.0])
    sizes = np.interp(shares, [0.0, 0.02, 0.2, 0.6, 1.0], [foot, foot, (foot + waist) / 2 * 0.95, waist, head])
    shape = oval(1.0, 1.0, 2.5) if rng.random() < 0.7 else rectangle(1.0, 1.0, 0.2)
    deep = float(rng.uniform(0.75, 1.0))
    return loft([raised(shape * [deep, 1.0], x, 0.0, top * s, z) for s, z in zip(shares, sizes, strict=True)], china)


def _legs(rng: np.random.Generator, depth: float, width: float, top: float) -> list[Mesh]:
    """Four legs of metal or wood, or two in front, with or without a rail round them."""
    square, material = rng.random() < 0.5, (CHROME, BLACK, wood(rng))[int(rng.choice(3, p=[0.5, 0.3, 0.2]))]
    thick = float(rng.uniform(0.012, 0.022))
    a, b = depth / 2 - thick, width / 2 - thick
    meshes = []
    for x in (-a, a):
        for y in (-b, b):
            if square:
                meshes.append(block(x, y, 0.0, 2 * thick, 2 * thick, top, material))
            else:
                meshes.append(tube((x, y, 0.0), (x, y, top), thick, material))
    if rng.random() < 0.7:
        rail = top * float(rng.choice([0.3, 0.75, 0.8]))
        for start, end in (((-a, -b), (a, -b)), ((-a, b), (a, b)), ((a, -b), (a, b)), ((-a, -b), (-a, b))):
            meshes.append(tube((*start, rail), (*end, rail), thick * 0.6, material))
    return meshes


def _drain(x: float, top: float, floor: bool) -> list[Mesh]:
    """A trap under the bowl, chrome; its pipe goes to the wall, or down to the floor."""
    low = top - 0.16
    meshes = [
        tube((x, 0, low), (x, 0, top + 0.03), 0.017, CHROME),
        tube((x, 0, low - 0.05), (x, 0, low + 0.04), 0.032, CHROME),
    ]
    meshes.append(tube((x, 0, low + 0.025), (x - 0.14, 0, low + 0.025), 0.017, CHROME))
    if floor:
        meshes.append(tube((x - 0.13, 0, 0.0), (x - 0.13, 0, low + 0.03), 0.022, CHROME))
        meshes.append(tube((x - 0.13, 0, 0.0), (x - 0.13, 0, 0.012), 0.04, CHROME))
    return meshes


def _tap(rng: np.random.Generator, x: float, z: float, tall: float, reach: float) -> Mesh:
    """A mixer with a lever, or a spout between two taps."""
    metal = CHROME if rng.random() < 0.85 else (BLACK if rng.random() < 0.5 else BRASS)
    reach, thick = min(reach, 0.16), float(rng.uniform(0.009, 0.015))
    meshes = [tube((x, 0.0, z), (x, 0.0, z + 0.012), thick * 2.0, metal)]
    bow = arc((x, 0.0, z), (x + reach, 0.0, z), (0.0, 0.0, tall), 15)[:11]
    if rng.random() < 0.5:
        bow = np.array(
            [[x, 0, z], [x, 0, z + tall * 0.6], [x + reach * 0.1, 0, z + tall * 0.72], [x + reach, 0, z + tall * 0.6]]
        )
    meshes.append(rod(bow, thick, metal, across=(0.0, 1.0, 0.0)))
    if rng.random() < 0.55:
        meshes.append(tube((x, 0.0, z + tall * 0.5), (x, 0.0, z + tall * 0.95), thick * 1.4, metal))
        meshes.append(tube((x, 0.0, z + tall * 0.93), (x + 0.08, 0.0, z + tall * 1.1), thick * 0.7, metal))
    else:
        for y in (-0.085, 0.085):
            meshes.append(tube((x, y, z), (x, y, z + 0.045), thick * 1.1, metal))
            meshes.append(tube((x, y - 0.026, z + 0.05), (x, y + 0.026, z + 0.05), thick * 0.7, metal))
            meshes.append(tube((x - 0.026, y, z + 0.05), (x + 0.026, y, z + 0.05), thick * 0.7, metal))
    return joined(meshes)
