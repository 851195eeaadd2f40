"""What table tops stand on: legs, trestles, slabs, crosses, hoops, rods, columns, stars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.cut import beam, bent, plate, rectangle, rounded_outline
from edgemap.simulation.apartment.made.shapes import block, lathe, metal, tube
from edgemap.simulation.render.mesh import Array, Material, Mesh


@dataclass(frozen=True, slots=True)
class Table:
    """What feet have to fit: the top's size and its lower face's height, metres, and materials."""

    depth: float
    width: float
    under: float
    round_: bool
    top: Material
    feet: Material


Feet = Callable[[np.random.Generator, Table], list[Mesh]]


def _corners(table: Table, inset: float) -> Array:
    """Where four feet stand under the top (4, 2)."""
    half = np.array([table.depth, table.width]) / 2.0 * (0.62 if table.round_ else 1.0)
    return np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * (half - (0.0 if table.round_ else inset))


def _legs(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Four legs: square or round, straight or tapered or turned, upright or splayed; apron, stretchers, drawer."""
    size = float(rng.uniform(0.035, 0.1))
    style = int(rng.integers(5))
    inset = size / 2.0 + float(rng.choice([0.0, 0.01, 0.04, 0.1]))
    spread = float(rng.uniform(0.02, 0.1)) if style in (1, 3) and rng.random() < 0.6 else 0.0
    taper = float(rng.uniform(0.45, 0.8)) if style in (1, 3) else 1.0
    corners, meshes = _corners(table, inset + (spread * 0.7 if inset < 0.1 else 0.0)), []
    profile = _turned(rng, size / 2.0) if style == 4 else None
    for x, y in corners:
        foot = np.array([x + np.sign(x) * spread, y + np.sign(y) * spread, 0.0])
        head = np.array([x, y, table.under - 0.5 * size * spread])
        if profile is not None:
            up = np.linspace(0.0, 1.0, 26)
            meshes.append(Mesh((lathe(profile(up), up * table.under * 0.86, table.feet, 14).moved(np.eye(3), foot),)))
            meshes.append(block(x, y, table.under * 0.85, size, size, table.under * 0.15, table.feet))
        elif style in (2, 3):
            meshes.append(tube(head, foot, size / 2.0, table.feet, size / 2.0 * taper))
        else:
            meshes.append(beam(head, foot, (size, size), table.feet, taper))
    glass = table.top.opacity < 1.0
    if glass or rng.random() < 0.65:
        tall = float(rng.uniform(0.05, 0.12)) if not glass else float(rng.uniform(0.02, 0.05))
        meshes += _apron(corners, table.under - tall, tall, 0.022, table.feet)
        if rng.random() < 0.15 and not glass and not table.round_:
            meshes += _drawer(rng, corners, table, tall)
    if rng.random() < 0.22:
        z = float(rng.uniform(0.1, 0.22))
        out = corners + np.sign(corners) * spread * (1.0 - z / table.under)
        meshes += _stretchers(rng, out, z, min(0.04, size * 0.8), table.feet)
    return meshes


def _turned(rng: np.random.Generator, radius: float) -> PchipInterpolator:
    """A turned leg's radius by height: foot, ring, belly, neck, block."""
    knots = np.array([0.0, 0.06, 0.13, 0.2, float(rng.uniform(0.35, 0.6)), 0.78, 0.84, 0.9, 1.0])
    belly, neck = float(rng.uniform(0.7, 1.25)), float(rng.uniform(0.5, 0.75))
    factors = np.array([0.55, 0.85, 0.5, neck, belly, neck, 1.05, 0.7, 0.95])
    return PchipInterpolator(knots, factors * radius)


def _apron(corners: Array, low: float, tall: float, thick: float, material: Material) -> list[Mesh]:
    (x, y), _, _, _ = np.abs(corners)
    return [block(sign * x, 0.0, low, thick, 2.0 * y, tall, material) for sign in (-1.0, 1.0)] + [
        block(0.0, sign * y, low, 2.0 * x, thick, tall, material) for sign in (-1.0, 1.0)
    ]


def _drawer(rng: np.random.Generator, corners: Array, table: Table, tall: float) -> list[Mesh]:
    wide, x = float(rng.uniform(0.3, 0.45)), float(np.abs(corners[0, 0])) + 0.012
    front = block(x, 0.0, table.under - tall + 0.008, 0.012, wide, tall - 0.014, table.feet)
    return [front, tube((x, 0.0, table.under - tall / 2), (x + 0.028, 0.0, table.under - tall / 2), 0.013, metal(rng))]


def _stretchers(rng: np.random.Generator, corners: Array, z: float, size: float, material: Material) -> list[Mesh]:
    """Bars low between the legs: all round, or as an H."""
    (x, y), way = np.abs(corners[0]), rng.random()
    ends = [beam((-x, s * y, z), (x, s * y, z), (size, size), material) for s in (-1.0, 1.0)]
    if way < 0.5:
        return ends + [beam((0.0, -y, z), (0.0, y, z), (size, size), material)]
    return ends + [beam((s * x, -y, z), (s * x, y, z), (size, size), material) for s in (-1.0, 1.0)]


def _trestles(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Two sawhorses: slanted legs, a bar on top, cross bars."""
    at = table.width / 2.0 - float(rng.uniform(0.15, 0.35))
    reach, size = table.depth / 2.0 - 0.06, float(rng.uniform(0.03, 0.06))
    lean, meshes = float(rng.uniform(0.04, 0.14)), []
    narrow = float(rng.uniform(0.15, 0.8))
    for side in (-1.0, 1.0):
        y = side * at
        bar = table.under - size
        meshes.append(block(0.0, y, bar, 2.0 * reach, size, size, table.feet))
        for end in (-1.0, 1.0):
            for way in (-1.0, 1.0):
                foot = (end * reach * 0.95, y + way * lean, 0.0)
                meshes.append(beam((end * reach * narrow, y, bar + 0.005), foot, (size, size * 0.7), table.feet))
        z = float(rng.uniform(0.15, 0.3))
        meshes.append(beam((-reach * 0.85, y, z), (reach * 0.85, y, z), (size * 0.7, size), table.feet))
        meshes.append(
            beam((end_x := reach * 0.9, y - lean, z), (end_x, y + lean, z), (size * 0.6, size * 0.6), table.feet)
        )
        meshes.append(beam((-end_x, y - lean, z), (-end_x, y + lean, z), (size * 0.6, size * 0.6), table.feet))
    return meshes


def _columns(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A trestle table of old: a post at each end on a foot across, a beam between them."""
    at, size = table.width / 2.0 * float(rng.uniform(0.55, 0.75)), float(rng.uniform(0.07, 0.14))
    reach, foot = table.depth * float(rng.uniform(0.35, 0.45)), float(rng.uniform(0.05, 0.09))
    meshes = []
    for y in (-at, at):
        meshes.append(block(0.0, y, 0.0, 2.0 * reach, size, foot, table.feet))
        meshes.append(block(0.0, y, table.under - 0.05, 1.8 * reach, size, 0.05, table.feet))
        if rng.random() < 0.5:
            meshes.append(block(0.0, y, foot, size * 1.6, size * 0.8, table.under - foot, table.feet))
        else:
            for x in (-0.3 * reach, 0.3 * reach):
                meshes.append(block(x, y, foot, size * 0.7, size * 0.8, table.under - foot, table.feet))
    z = float(rng.choice([0.12, 0.3, table.under - 0.12]))
    meshes.append(beam((0.0, -at, z), (0.0, at, z), (0.05, 0.09), table.feet))
    return meshes


def slabs(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Two upright boards near the ends, or flush with them, and perhaps a rail."""
    thick = float(rng.choice([0.025, 0.04, 0.06]))
    at = table.width / 2.0 - thick / 2.0 - float(rng.choice([0.0, 0.1, 0.3]))
    deep = table.depth * float(rng.choice([1.0, 0.85, 0.6]))
    meshes = [block(0.0, y, 0.0, deep, thick, table.under, table.feet) for y in (-at, at)]
    if rng.random() < 0.6:
        tall = float(rng.uniform(0.08, 0.3))
        meshes.append(block(0.0, 0.0, table.under - tall, 0.025, 2.0 * at, tall, table.feet))
    return meshes


def _crosses(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Legs that cross in an X at each end, joined by a bar."""
    at, size = table.width / 2.0 * float(rng.uniform(0.6, 0.85)), float(rng.uniform(0.035, 0.09))
    reach, meshes = table.depth / 2.0 - 0.08, []
    half = size / 2.0
    for y in (-at, at):
        for way in (-1.0, 1.0):
            start, end = (way * reach, y + way * half * 0.4, 0.0), (-way * reach, y + way * half * 0.4, table.under)
            meshes.append(beam(start, end, (size, size * 0.8), table.feet))
        meshes.append(block(0.0, y, table.under - 0.03, 2.0 * reach + size, size, 0.03, table.feet))
    meshes.append(beam((0.0, -at, table.under / 2), (0.0, at, table.under / 2), (size * 0.8, size * 0.8), table.feet))
    return meshes


def _hoops(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A frame of metal at each end: a rectangle, a trapezium or a V of flat bar."""
    size, at = float(rng.uniform(0.03, 0.09)), table.width / 2.0 - float(rng.uniform(0.05, 0.3))
    upper = (table.depth / 2.0 - 0.05) * float(rng.choice([1.0, 1.0, 0.55]))
    lower = (table.depth / 2.0 - 0.05) * float(rng.choice([1.0, 1.0, 0.6]))
    material, meshes = metal(rng), []
    thin = size * float(rng.choice([1.0, 0.4]))
    for y in (-at, at):
        for way in (-1.0, 1.0):
            meshes.append(beam((way * lower, y, 0.0), (way * upper, y, table.under), (thin, size), material))
        for z, half in ((0.0, lower), (table.under - thin, upper)):
            meshes.append(block(0.0, y, z, 2.0 * half + thin, size, thin, material))
    if table.top.opacity < 1.0 or rng.random() < 0.4:
        meshes.append(block(0.0, 0.0, table.under - 0.03, 0.05, 2.0 * at, 0.03, material))
    return meshes


def _hairpins(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Bent rods: four hairpin legs, or the folding kind, a U of tube at each end with a brace."""
    material = metal(rng)
    if rng.random() < 0.5:
        meshes = []
        for x, y in _corners(table, 0.12):
            foot = np.array([x * 1.06, y * 1.06, 0.004])
            for dx, dy in ((0.07, 0.0), (0.0, 0.07)):
                meshes.append(tube(foot, (x - np.sign(x) * dx, y - np.sign(y) * dy, table.under), 0.006, material))
        return meshes
    radius, reach = float(rng.uniform(0.011, 0.016)), table.depth / 2.0 * (0.6 if table.round_ else 0.82)
    meshes = []
    at = table.width / 2.0 * (0.55 if table.round_ else 0.75)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 7)
    arc = np.stack([np.zeros(7), reach - 0.05 + 0.05 * np.cos(turn), radius + 0.05 + 0.05 * np.sin(turn)], axis=1)[:4]
    right = [(x, z) for _, x, z in arc]
    path = [(-reach, table.under), *((-x, z) for x, z in right[::-1]), *right, (reach, table.under)]
    for side in (-1.0, 1.0):
        y = side * at
        meshes.append(bent([(x, y, z) for x, z in path], radius, material))
        z = float(rng.uniform(0.3, 0.45))
        meshes.append(tube((-reach, y, z), (reach, y, z), radius * 0.8, material))
        meshes.append(tube((0.0, y, z), (0.0, y - side * at * 0.55, table.under), radius * 0.7, material))
    return meshes


def _pedestal(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A column in the middle, two under a long top: turned, plain, a tulip or a drum; on a plate or on feet."""
    long = table.width > 1.5 * table.depth
    places = (-table.width / 4.2, table.width / 4.2) if long else (0.0,)
    reach = min(table.depth, table.width) * float(rng.uniform(0.26, 0.36))
    style, meshes = rng.random(), []
    up = np.linspace(0.0, 1.0, 24)
    thin = float(rng.uniform(0.035, 0.07))
    if style < 0.25:  # A tulip's trumpet.
        radius = PchipInterpolator(
            [0.0, 0.02, 0.1, 0.45, 0.85, 1.0], [reach, reach, reach * 0.5, thin, thin, reach * 0.4]
        )
    elif style < 0.35:  # A drum or a cone.
        radius = PchipInterpolator([0.0, 0.5, 1.0], reach * rng.uniform(0.55, 1.0, 3))
    elif style < 0.7:
        radius = PchipInterpolator([0.0, 0.08, 0.2, 0.35, 0.55, 0.8, 0.9, 1.0], thin * rng.uniform(0.8, 2.0, 8))
    else:
        radius = PchipInterpolator([0.0, 0.5, 1.0], [thin, thin, thin])
    feet = 0 if style < 0.35 else int(rng.choice([0, 0, 3, 4, 4]))
    lift = 0.08 if feet else 0.0
    for y in places:
        column = lathe(radius(up), lift + up * (table.under - lift), table.feet)
        meshes.append(Mesh((column.moved(np.eye(3), np.array([0.0, y, 0.0])),)))
        start = float(rng.uniform(0.0, np.pi)) if feet == 3 else (0.0 if rng.random() < 0.5 else np.pi / 4)
        for turn in start + np.arange(feet) * 2.0 * np.pi / max(feet, 1):
            way = np.array([np.cos(turn), np.sin(turn), 0.0])
            hip, knee, toe = (0.24, 0.17, 0.03)
            path = [way * r + [0.0, y, z] for r, z in ((0.02, hip), (reach * 0.5, knee), (reach * 1.15, toe))]
            meshes.append(_curved(path, (0.045, 0.03), table.feet))
        if not feet and style >= 0.35:
            base = (
                rounded_outline(2 * reach, 2 * reach, 2.0)
                if table.round_ or rng.random() < 0.6
                else rectangle(1.8 * reach, 1.8 * reach)
            )
            meshes.append(plate(base + [0.0, y], 0.0, float(rng.uniform(0.012, 0.04)), table.feet))
    if style < 0.35 and table.top.opacity == 1.0:
        return meshes
    inner = rounded_outline(reach * 1.4, reach * 1.4, 2.0)
    return meshes + [plate(inner + [0.0, y], table.under - 0.025, 0.025, table.feet) for y in places]


def _curved(path: list[Array], radii: tuple[float, float], material: Material) -> Mesh:
    """A foot bent through three points, tapering, its toe rounded off."""
    t = np.linspace(0.0, 1.0, 8)[:, None]
    points = (1 - t) ** 2 * path[0] + 2 * t * (1 - t) * (path[1] + [0.0, 0.0, 0.05]) + t**2 * path[2]
    radius = np.linspace(*radii, 8)
    radius[-1] = 0.004
    return bent(points, radius, material, 10)


def _spider(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Slanted bars from the middle of the floor or of the top outwards: a star, a cross or a butterfly."""
    count, size = int(rng.choice([3, 4, 4, 4])), float(rng.uniform(0.025, 0.07))
    meshes, inward = [], rng.random() < 0.5
    for turn in np.pi / 4 + np.arange(count) * 2.0 * np.pi / count:
        way = np.array([np.cos(turn) * table.depth, np.sin(turn) * table.width, 0.0]) * 0.4
        near, far = way * 0.12, way
        foot, head = (far, near) if inward else (near, far * 0.9)
        far_through = head + [0.0, 0.0, table.under]
        meshes.append(beam(foot, far_through, (size, size), table.feet))
    hub = 0.09 if inward else 0.07
    z = table.under - 0.03 if inward else 0.0
    meshes.append(plate(rounded_outline(4 * hub, 4 * hub, 2.0), z, 0.03, table.feet))
    return meshes


# What may stand under a long top, and under one as deep as wide.
FEET_LONG: tuple[Feet, ...] = (
    _legs, _legs, _legs, _legs, _trestles, _columns, slabs, _crosses, _hoops, _hairpins, _pedestal, _spider,
)  # fmt: skip
FEET_SQUARE: tuple[Feet, ...] = (_legs, _legs, _legs, _pedestal, _pedestal, _pedestal, _hairpins, _spider, _crosses)
