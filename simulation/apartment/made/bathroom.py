"""Toilets and washbasins."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.lofts import arc, at, loft, oval, pipe, rectangle, rounded
from edgemap.simulation.apartment.made.shapes import BLACK, block, drawn_colour, joined, tube, wood
from edgemap.simulation.render.mesh import Array, Material, Mesh, box

_CHROME = Material((0.6, 0.6, 0.62), gloss=0.6)
_WATER = Material((0.35, 0.4, 0.42), gloss=0.6)


def _china(rng: np.random.Generator) -> Material:
    """Glazed white, now and then cream, grey, black or a pastel colour."""
    if rng.random() < 0.12:
        if rng.random() < 0.25:
            return Material((0.04, 0.04, 0.042), gloss=0.5)
        red, green, blue = drawn_colour(rng, 0.35)
        lift = 0.6 / max(red, green, blue)
        return Material((red * lift, green * lift, blue * lift), gloss=0.4)
    value = float(rng.uniform(0.66, 0.82))
    return Material((value, value * 0.995, value * float(rng.uniform(0.9, 1.0))), gloss=float(rng.uniform(0.25, 0.5)))


def toilet(rng: np.random.Generator) -> Mesh:
    """A bowl on a foot or hung on a box, with seat and lid, and a cistern behind it, or none to be seen."""
    china = _china(rng)
    build = str(rng.choice(["close", "hung", "bare", "skirted"], p=[0.5, 0.2, 0.1, 0.2]))
    long, wide = float(rng.uniform(0.42, 0.52)), float(rng.uniform(0.34, 0.39))
    rim = float(rng.uniform(0.37, 0.43))
    outline = oval(long, wide, back=float(rng.uniform(2.4, 3.6)), front=float(rng.uniform(1.8, 2.6)))
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
        button = _CHROME if rng.random() < 0.5 else china
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
        rings.append(at(ring, shift, 0.0, low + height * (rim - low)))
    meshes = [loft(rings, china, high=False)]
    # Rim and hollow: ever smaller rings inwards and down.
    sizes, depths = [0.985, 0.9, 0.74, 0.7, 0.62, 0.45, 0.3], [0.0, 0.0, 0.0, 0.03, 0.1, 0.17, 0.2]
    inner = [at(outline, 0.01 * (1 - s), 0.0, rim - d, s) for s, d in zip(sizes, depths, strict=True)]
    meshes.append(loft(inner[:3], china, low=False, high=False))
    meshes.append(loft(inner[2:], china, low=False, high=False))
    meshes.append(
        loft([at(outline, 0.0, 0.0, rim - 0.201, 0.3), at(outline, 0.0, 0.0, rim - 0.16, 0.46)], _WATER, low=False)
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
        rings.append(at(rectangle(deep, across, radius), face - depth / 2.0, 0.0, low + height * (tall - 0.03)))
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
        meshes.append(tube((face - depth / 2, 0, top - 0.002), (face - depth / 2, 0, top + 0.008), 0.026, _CHROME))
    else:
        y, z, x = width * 0.36, top - 0.085, face - 0.012
        meshes.append(tube((x, y, z), (x + 0.022, y, z), 0.013, _CHROME))
        meshes.append(tube((x + 0.022, y + 0.01, z), (x + 0.03, y - 0.075, z - 0.008), 0.007, _CHROME))
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
            [at(outline, 0.012, 0.0, bottom + tall * h, size * s) for h, s in zip(heights, sizes, strict=True)],
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
        rings = [at(outline, 0.012, 0.0, bottom + h, size * s) for s, h in rows]
        return loft(rings, material, low=False, high=False)

    lean = float(rng.uniform(0.06, 0.2))
    if way < 0.55:
        return joined([*meshes, ring(low), slab(low + thick + 0.003, thick)])
    raised = _raised(slab(low, thick * 0.7), hinge, low, lean)
    if way < 0.85:
        return joined([*meshes, ring(low), raised])
    return joined([*meshes, raised, _raised(ring(low + thick + 0.004), hinge, low, lean)])


def _raised(mesh: Mesh, hinge: float, z: float, lean: float) -> Mesh:
    """What lay on the bowl, turned up about its hinge, a little short of upright or past it."""
    turn = -np.pi / 2.0 + lean
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    pivot = np.array([hinge - 0.01, 0.0, z])
    shift = pivot + [0.03, 0.0, 0.0] - rotation @ pivot
    return Mesh(tuple(part.moved(rotation, shift) for part in mesh.parts))


def basin(rng: np.random.Generator) -> Mesh:
    """A washbasin on a pedestal, a column, legs, a small table, or on its waste pipe alone, with a tap."""
    china = _china(rng)
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
        outline = oval(depth, width, back=float(rng.uniform(2.0, 5.0)), front=float(rng.uniform(2.0, 3.0)))
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
            loft([at(outline, 0.0, 0.0, height * s, z) for s, z in zip(shares, sizes, strict=True)], china, high=False)
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
        [at(outline, -shift * (1.0 - s), 0.0, height - tall * (1.0 - s), z) for s, z in rows], china, high=False
    )
    return joined([outside, _inside(china, outline, height, tall * 0.8, 0.09 if shift else 0.04)])


def _inside(china: Material, outline: Array, height: float, deep: float, rim: float) -> Mesh:
    """Rim and hollow of a basin; behind the hollow room for a tap where the rim is wide."""
    forward = rim * 0.32
    edge = at(outline, 0.0, 0.0, height, 0.99)
    parts = [(1.0, 0.0), (0.96, 0.2), (0.85, 0.6), (0.6, 0.9), (0.12, 1.0)]
    size = 1.0 - 2.0 * rim
    depth = np.ptp(outline[:, 0])
    inner = [
        at(outline * [size * s - (rim if rim > 0.06 else 0.0) * s, size * s], forward * depth, 0.0, height - deep * d)
        for s, d in parts
    ]
    drain = tube((forward * depth, 0.0, height - deep), (forward * depth, 0.0, height - deep + 0.004), 0.022, _CHROME)
    return joined([loft([edge, inner[0]], china, low=False, high=False), loft(inner, china, low=False), drain])


def _pedestal(rng: np.random.Generator, china: Material, x: float, top: float, width: float) -> Mesh:
    """A turned or square column that spreads at its foot and under the bowl."""
    waist, foot = width * float(rng.uniform(0.17, 0.3)), width * float(rng.uniform(0.3, 0.46))
    head = width * float(rng.uniform(0.3, 0.5))
    shares = np.array([0.0, 0.02, 0.06, 0.15, 0.35, 0.6, 0.85, 1.0])
    sizes = np.interp(shares, [0.0, 0.02, 0.2, 0.6, 1.0], [foot, foot, (foot + waist) / 2 * 0.95, waist, head])
    shape = oval(1.0, 1.0, 2.5, 2.5) if rng.random() < 0.7 else rectangle(1.0, 1.0, 0.2)
    deep = float(rng.uniform(0.75, 1.0))
    return loft([at(shape * [deep, 1.0], x, 0.0, top * s, z) for s, z in zip(shares, sizes, strict=True)], china)


def _legs(rng: np.random.Generator, depth: float, width: float, top: float) -> list[Mesh]:
    """Four legs of metal or wood, or two in front, with or without a rail round them."""
    square, material = rng.random() < 0.5, (_CHROME, BLACK, wood(rng))[int(rng.choice(3, p=[0.5, 0.3, 0.2]))]
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
        tube((x, 0, low), (x, 0, top + 0.03), 0.017, _CHROME),
        tube((x, 0, low - 0.05), (x, 0, low + 0.04), 0.032, _CHROME),
    ]
    meshes.append(tube((x, 0, low + 0.025), (x - 0.14, 0, low + 0.025), 0.017, _CHROME))
    if floor:
        meshes.append(tube((x - 0.13, 0, 0.0), (x - 0.13, 0, low + 0.03), 0.022, _CHROME))
        meshes.append(tube((x - 0.13, 0, 0.0), (x - 0.13, 0, 0.012), 0.04, _CHROME))
    return meshes


def _tap(rng: np.random.Generator, x: float, z: float, tall: float, reach: float) -> Mesh:
    """A mixer with a lever, or a spout between two taps."""
    metal = (
        _CHROME if rng.random() < 0.85 else (BLACK if rng.random() < 0.5 else Material((0.45, 0.33, 0.12), gloss=0.5))
    )
    reach, thick = min(reach, 0.16), float(rng.uniform(0.009, 0.015))
    meshes = [tube((x, 0.0, z), (x, 0.0, z + 0.012), thick * 2.0, metal)]
    bow = arc((x, 0.0, z), (x + reach, 0.0, z), (0.0, 0.0, tall), 15)[:11]
    if rng.random() < 0.5:
        bow = np.array(
            [[x, 0, z], [x, 0, z + tall * 0.6], [x + reach * 0.1, 0, z + tall * 0.72], [x + reach, 0, z + tall * 0.6]]
        )
    meshes.append(pipe(bow, thick, (0.0, 1.0, 0.0), metal))
    if rng.random() < 0.55:
        meshes.append(tube((x, 0.0, z + tall * 0.5), (x, 0.0, z + tall * 0.95), thick * 1.4, metal))
        meshes.append(tube((x, 0.0, z + tall * 0.93), (x + 0.08, 0.0, z + tall * 1.1), thick * 0.7, metal))
    else:
        for y in (-0.085, 0.085):
            meshes.append(tube((x, y, z), (x, y, z + 0.045), thick * 1.1, metal))
            meshes.append(tube((x, y - 0.026, z + 0.05), (x, y + 0.026, z + 0.05), thick * 0.7, metal))
            meshes.append(tube((x - 0.026, y, z + 0.05), (x + 0.026, y, z + 0.05), thick * 0.7, metal))
    return joined(meshes)
