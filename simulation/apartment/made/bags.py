"""Backpacks, and luggage that is no trolley: duffels, trunks, briefcases, suitcases of cloth and of leather."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.lofts import arc, at, loft, oval, pipe, rectangle, rounded
from edgemap.simulation.apartment.made.shapes import BLACK, STEEL, block, cushion, drawn_colour, fabric, joined, tube
from edgemap.simulation.render.mesh import Array, Material, Mesh, box

# Depth, width, middle x and middle y of a bag at a share of its height.
Ring = Callable[[float], tuple[float, float, float, float]]
_BRASS = Material((0.45, 0.33, 0.12), gloss=0.5)
_ZIP = Material((0.02, 0.02, 0.022), gloss=0.15)


def backpack(rng: np.random.Generator) -> Mesh:
    """A bag of cloth that stands on the floor, pockets to the front, two straps behind, a loop on top."""
    build = str(rng.choice(["school", "laptop", "hiking", "flap"], p=[0.4, 0.2, 0.22, 0.18]))
    height = float(rng.uniform(0.55, 0.72)) if build == "hiking" else float(rng.uniform(0.38, 0.52))
    width = float(rng.uniform(0.27, 0.35))
    depth = float(rng.uniform(0.13, 0.18)) if build == "laptop" else float(rng.uniform(0.16, 0.25))
    cloth, second = _cloth(rng), _cloth(rng) if rng.random() < 0.55 else None
    second = second or cloth
    strap = BLACK if rng.random() < 0.6 else Material(drawn_colour(rng, 0.8))
    dome = {"laptop": 0.12, "flap": 0.1, "hiking": 0.14}.get(build, float(rng.uniform(0.16, 0.3)))
    outline = oval(1.0, 1.0, back=float(rng.uniform(5.0, 8.0)), front=float(rng.uniform(2.6, 4.5)))
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
        rings.append(at(outline * [d * size, w * size], x, y, share * height))
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
    meshes.append(pipe(loop, 0.004, (1.0, 0.0, 0.0), strap, wide=0.013))
    return joined(meshes)


def _cloth(rng: np.random.Generator) -> Material:
    """What bags are sewn from: black, grey or navy more often than not, else any cloth."""
    if rng.random() < 0.45:
        value = float(rng.uniform(0.015, 0.12))
        return Material(
            (value, value * float(rng.uniform(0.95, 1.1)), value * float(rng.uniform(1.0, 1.7))), gloss=0.08
        )
    return fabric(rng)


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
        meshes.append(pipe(points, 0.006, (0.0, 1.0, side * 0.25), strap, wide=wide))
    if build == "hiking" and rng.random() < 0.8:
        d, w, x, _ = ring(0.14)
        for side in (-1.0, 1.0):
            belt = arc(
                (x - d * 0.45, side * w * 0.3, height * 0.14),
                (x + d * 0.1, side * (w * 0.52 + 0.02), height * 0.12),
                (-0.04, side * 0.05, 0.0),
            )
            meshes.append(pipe(belt, 0.008, (0.0, 0.0, 1.0), strap, wide=0.035))
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
            meshes.append(block(middle[0] + thick * 0.47, y, z, 0.012, wide * 0.76, 0.009, _ZIP))
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
    return [pipe(np.concatenate([line, crown, other]), 0.003, (1.0, 0.0, 0.0), _ZIP, wide=0.007)] if dome else []


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
        meshes.append(pipe(points, 0.006, (0.0, 1.0, 0.0), cloth, wide=width * 0.46))
    count = int(rng.integers(1, 3))
    for offset in [0.0] if count == 1 else [-width * 0.22, width * 0.22]:
        points = np.array(front) + [0.009, y + offset, 0.0]
        meshes.append(pipe(points, 0.003, (0.0, 1.0, 0.0), strap, wide=0.012))
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


def other_luggage(rng: np.random.Generator) -> Mesh:
    """Any luggage but a hard trolley."""
    makers = (_soft_trolley, _duffel, _trunk, _briefcase, _old_suitcase)
    return makers[int(rng.choice(5, p=[0.34, 0.18, 0.14, 0.12, 0.22]))](rng)


def _soft_trolley(rng: np.random.Generator) -> Mesh:
    """An upright trolley of cloth: piped edges, pockets in front, wheels, a handle drawn out or not."""
    width, height = float(rng.uniform(0.34, 0.5)), float(rng.uniform(0.48, 0.74))
    depth, foot = width * float(rng.uniform(0.5, 0.68)), float(rng.uniform(0.02, 0.055))
    cloth, trim = _cloth(rng), BLACK if rng.random() < 0.7 else Material(drawn_colour(rng, 0.7))
    x, y, top = depth / 2, width / 2, foot + height
    radius = float(rng.uniform(0.03, 0.08))
    meshes = [rounded((-x, -y, foot), (x, y, top), cloth, radius, float(rng.uniform(0.012, 0.03)), axis=0)]
    outline = rectangle(width - 0.012, height - 0.012, radius - 0.004, steps=6)
    for at_x in (-x + 0.012, x - 0.012):
        edge = np.concatenate([np.full((len(outline), 1), at_x), outline + [0.0, foot + height / 2]], axis=1)
        meshes.append(_hoop(edge, 0.009, trim))
    low = foot + 0.05
    for _ in range(int(rng.integers(1, 3))):
        tall = (top - low) * float(rng.uniform(0.45, 0.8))
        thick, wide = float(rng.uniform(0.03, 0.06)), width * float(rng.uniform(0.72, 0.88))
        meshes.append(rounded((x - 0.01, -wide / 2, low), (x + thick, wide / 2, low + tall), cloth, 0.04, 0.02, axis=0))
        meshes.append(block(x + thick - 0.002, 0.0, low + tall - 0.05, 0.006, wide * 0.8, 0.01, _ZIP))
        low += tall + 0.015
        if top - low < 0.14:
            break
    for at_x in (-x + 0.04, x - 0.04):
        for at_y in (-y + 0.045, y - 0.045):
            meshes.append(tube((at_x, at_y - 0.014, 0.024), (at_x, at_y + 0.014, 0.024), 0.024, BLACK))
            meshes.append(block(at_x, at_y, 0.024, 0.035, 0.034, max(foot - 0.01, 0.01), BLACK))
    meshes.append(
        pipe(
            arc((0.0, -0.08, top - 0.006), (0.0, 0.08, top - 0.006), (0, 0, 0.035)), 0.006, (1, 0, 0), trim, wide=0.014
        )
    )
    if rng.random() < 0.45:
        up, back = top + float(rng.uniform(0.2, 0.4)), -x + 0.03
        meshes += [tube((back, s, top - 0.03), (back, s, up), 0.008, STEEL) for s in (-0.1, 0.1)]
        meshes.append(
            rounded((back - 0.014, -0.12, up - 0.005), (back + 0.014, 0.12, up + 0.025), BLACK, 0.01, 0.006, axis=1)
        )
    return joined(meshes)


def _hoop(line: Array, radius: float, material: Material) -> Mesh:
    """A bar along a closed line (N, 3) in a plane of constant x."""
    wrapped = np.concatenate([line[-2:-1], line, line[1:2]])
    tangents = wrapped[2:] - wrapped[:-2]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.array([1.0, 0.0, 0.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 7)
    c, s = np.cos(turn)[None, :, None], np.sin(turn)[None, :, None]
    rings = line[:, None] + radius * (c * across + s * np.cross(tangents, across)[:, None])
    return loft(rings, material, low=False, high=False)


def _duffel(rng: np.random.Generator) -> Mesh:
    """A soft bag lying along y: a drum with flat underside, zip on top, two handles, bands round it."""
    long, tall = float(rng.uniform(0.45, 0.68)), float(rng.uniform(0.24, 0.33))
    deep = tall * float(rng.uniform(0.9, 1.15))
    cloth, strap = _cloth(rng), BLACK if rng.random() < 0.6 else Material(drawn_colour(rng, 0.8))
    turn = np.arange(28) * 2 * np.pi / 28
    c, s = np.cos(turn), np.sin(turn)
    power = np.where(c < 0.0, 0.5, 0.85)
    # Columns z, x so that the ring goes round counter-clockwise about y.
    section = np.stack([np.sign(c) * np.abs(c) ** power * tall / 2, np.sign(s) * np.abs(s) ** 0.75 * deep / 2], axis=1)
    section = np.concatenate([section, section[:1]])
    rows = [(-1.0, 0.84), (-0.985, 0.92), (-0.94, 0.98), (-0.8, 1.0), (0.0, float(rng.uniform(0.94, 1.04)))]
    rows += [(-y, size) for y, size in rows[-2::-1]]
    rings = []
    for y, size in rows:
        ring = np.empty((len(section), 3))
        ring[:, 0], ring[:, 1] = section[:, 1] * size, y * long / 2
        ring[:, 2] = section[:, 0] * size + tall / 2 * min(size, 1.0)
        rings.append(ring)
    meshes = [loft(rings, cloth)]
    meshes.append(block(0.0, 0.0, tall * 0.985, 0.018, long * 0.8, tall * 0.02 + 0.003, _ZIP))
    for y in (-long * 0.2, long * 0.2):
        half = section * 1.015
        ring = np.stack([half[:, 1], np.full(len(half), y), half[:, 0] + tall / 2], axis=1)
        rim = np.stack([ring + [0, -0.018, 0], ring + [0, 0.018, 0]])
        meshes.append(loft(rim, strap, low=False, high=False))
    for side in (-1.0, 1.0):
        up, x = float(rng.uniform(0.07, 0.16)), side * deep * 0.24
        bow = arc((x, -long * 0.2, tall * 0.93), (x, long * 0.2, tall * 0.93), (side * 0.02, 0.0, up), 13)
        meshes.append(pipe(bow, 0.006, (1.0, 0.0, -side * 0.2), strap, wide=0.014))
    if rng.random() < 0.6:
        meshes.append(cushion((deep * 0.46, 0.0, tall * 0.42), (0.05, long * 0.34, tall * 0.5), cloth, 5.0))
    return joined(meshes)


def _trunk(rng: np.random.Generator) -> Mesh:
    """A chest for travels: flat lid, metal or leather corners, bands, clasps, handles at the ends."""
    long, deep, tall = float(rng.uniform(0.55, 0.85)), float(rng.uniform(0.32, 0.46)), float(rng.uniform(0.26, 0.42))
    body = Material(drawn_colour(rng, 0.7), gloss=0.15) if rng.random() < 0.6 else fabric(rng)
    metal = _BRASS if rng.random() < 0.6 else STEEL
    x, y, seam = deep / 2, long / 2, tall * float(rng.uniform(0.62, 0.75))
    meshes = [
        box((-x, -y, 0.0), (x, y, seam - 0.002), body),
        box((-x + 0.003, -y + 0.003, seam - 0.003), (x - 0.003, y - 0.003, seam + 0.003), BLACK),
        rounded((-x, -y, seam + 0.002), (x, y, tall), body, 0.006, 0.006),
    ]
    for z in (seam - 0.02, seam + 0.004):
        meshes.append(box((-x - 0.003, -y - 0.003, z), (x + 0.003, y + 0.003, z + 0.016), metal))
    for at_x in (-x, x):
        for at_y in (-y, y):
            for z in (0.0, tall - 0.045):
                corner = np.array([at_x, at_y, z])
                low = corner - [0.045 if at_x > 0 else 0.004, 0.045 if at_y > 0 else 0.004, 0.0]
                meshes.append(box(low, low + [0.049, 0.049, 0.048], metal))
    for at_y in [-y * 0.5, y * 0.5] if rng.random() < 0.6 else [-y * 0.6, 0.0, y * 0.6]:
        meshes.append(
            rounded((x, at_y - 0.025, seam - 0.05), (x + 0.014, at_y + 0.025, seam + 0.035), metal, 0.01, 0.004, axis=0)
        )
    for side in (-1.0, 1.0):
        bow = arc((-0.07, side * y, tall * 0.45), (0.07, side * y, tall * 0.45), (0.0, side * 0.035, -0.02))
        meshes.append(pipe(bow, 0.008, (0.0, 0.2, 1.0), BLACK))
    if rng.random() < 0.5:
        wood_band = Material((0.25, 0.13, 0.05), gloss=0.1)
        for at_y in (-y * 0.33, y * 0.33):
            meshes.append(box((-x - 0.006, at_y - 0.02, 0.0), (x + 0.006, at_y + 0.02, tall + 0.006), wood_band))
    return joined(meshes)


def _case(rng: np.random.Generator, size: tuple[float, float, float], shell: Material, metal: Material) -> list[Mesh]:
    """An upright case (depth, width, height): two halves, a seam along the middle, grip and two locks on top."""
    depth, width, height = size
    x, y = depth / 2, width / 2
    radius = float(rng.uniform(0.015, 0.06))
    meshes = [rounded((-x, -y, 0.0), (x, y, height), shell, radius, float(rng.uniform(0.006, 0.02)), axis=0)]
    meshes.append(rounded((-0.006, -y - 0.003, 0.0), (0.006, y + 0.003, height + 0.003), metal, radius, 0.002, axis=0))
    grip = BLACK if rng.random() < 0.5 else shell
    meshes.append(
        pipe(
            arc((0, -0.07, height - 0.004), (0, 0.07, height - 0.004), (0, 0, 0.05)), 0.008, (1, 0, 0), grip, wide=0.012
        )
    )
    for at_y in (-width * 0.3, width * 0.3):
        meshes.append(block(0.0, at_y, height - 0.001, 0.05, 0.045, 0.009, metal))
    return meshes


def _briefcase(rng: np.random.Generator) -> Mesh:
    """A slim case for papers, of leather or metal."""
    metal = _BRASS if rng.random() < 0.5 else STEEL
    value = float(rng.uniform(0.015, 0.1))
    leather = Material((value * float(rng.uniform(1.0, 2.5)), value * 1.1, value), gloss=0.2)
    shell = Material((0.5, 0.5, 0.52), gloss=0.5) if rng.random() < 0.25 else leather
    size = (float(rng.uniform(0.08, 0.14)), float(rng.uniform(0.38, 0.47)), float(rng.uniform(0.27, 0.34)))
    return joined(_case(rng, size, shell, metal))


def _old_suitcase(rng: np.random.Generator) -> Mesh:
    """A suitcase carried by a grip on its long side: leather or card, corners and belts, or moulded and plain."""
    width = float(rng.uniform(0.48, 0.75))
    height, depth = width * float(rng.uniform(0.6, 0.75)), float(rng.uniform(0.16, 0.25))
    shell = Material(drawn_colour(rng, 0.8), gloss=float(rng.uniform(0.05, 0.3))) if rng.random() < 0.7 else fabric(rng)
    meshes = _case(rng, (depth, width, height), shell, _BRASS if rng.random() < 0.5 else STEEL)
    leather = Material((0.13, 0.06, 0.025), gloss=0.2)
    x, y = depth / 2, width / 2
    if rng.random() < 0.6:
        for at_y in (-y + 0.03, y - 0.03):
            for z in (0.0, height - 0.064):
                low = (-x - 0.004, at_y - 0.034, z - 0.002 if z == 0.0 else z)
                meshes.append(rounded(low, (x + 0.004, at_y + 0.034, z + 0.068), leather, 0.03, 0.008, axis=0))
    if rng.random() < 0.5:
        for at_y in (-width * 0.24, width * 0.24):
            meshes.append(box((-x - 0.004, at_y - 0.018, -0.003), (x + 0.004, at_y + 0.018, height + 0.004), leather))
            meshes.append(block(x + 0.004, at_y, height * 0.8, 0.008, 0.05, 0.04, _BRASS))
    return joined(meshes)
