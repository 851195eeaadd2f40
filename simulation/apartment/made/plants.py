"""Plants in pots: for the floor, and small ones for tables."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.cut import ball, bent
from edgemap.simulation.apartment.made.leaves import Growth, foliage, golden, green, leaves, ways
from edgemap.simulation.apartment.made.pots import pot
from edgemap.simulation.apartment.made.shapes import cushion, drawn_colour, grid, joined
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part

_UP = np.array([0.0, 0.0, 1.0])


def potted_plant(rng: np.random.Generator) -> Mesh:
    """A plant for the floor, 0.4 to 1.7 m high."""
    growth, low, high = _FLOOR[int(rng.integers(len(_FLOOR)))]
    total = float(rng.uniform(low, high))
    share = float(rng.uniform(0.2, 0.34)) if total > 0.8 else float(rng.uniform(0.3, 0.45))
    return _potted(rng, growth, total, share, (0.1, 0.22))


def small_plant(rng: np.random.Generator) -> Mesh:
    """A plant for a table or a sill, 0.15 to 0.4 m high."""
    growth = _SMALL[int(rng.integers(len(_SMALL)))]
    return _potted(rng, growth, float(rng.uniform(0.17, 0.38)), float(rng.uniform(0.28, 0.5)), (0.035, 0.085))


def _potted(rng: np.random.Generator, growth: Growth, total: float, share: float, radii: tuple[float, float]) -> Mesh:
    """A pot of this share of the total height, and what grows in it."""
    height = total * share
    radius = float(np.clip(height * rng.uniform(0.45, 0.75), *radii))
    meshes, soil = pot(rng, radius, height)
    parts = growth(rng, total - soil, radius * 0.75, soil)
    return joined([*meshes, Mesh(tuple(parts))])


def _bark(rng: np.random.Generator) -> Material:
    value = float(rng.uniform(0.04, 0.25))
    return Material((value, value * float(rng.uniform(0.65, 0.9)), value * float(rng.uniform(0.35, 0.7))))


def _stem(path: Array, radius: float, end: float, material: Material) -> list[Part]:
    return list(bent(path, np.linspace(radius, end, len(path)), material, 6).parts)


def _wander(rng: np.random.Generator, start: Array, end: Array, bow: float, points: int = 7) -> Array:
    """A path that bows and wavers between two points (3,)."""
    t = np.linspace(0.0, 1.0, points)[:, None]
    aside = rng.normal(0.0, bow, 3) * [1.0, 1.0, 0.2]
    other = rng.normal(0.0, 0.4 * bow, 3) * [1.0, 1.0, 0.1]
    return start + (end - start) * t + aside * np.sin(np.pi * t) + other * np.sin(2.0 * np.pi * t)


def _tree(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A ficus: one to three trunks, branches, and a crown of small leaves, round, egg-shaped or loose."""
    bark, start = _bark(rng), np.array([0.0, 0.0, z])
    crown = float(rng.uniform(0.45, 0.85)) * height
    wide = height * float(rng.uniform(0.18, 0.34))
    middle = z + height - crown / 2
    parts: list[Part] = []
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        foot = start + rng.normal(0.0, 0.15 * spread, 3) * [1, 1, 0]
        head = np.array([*rng.normal(0.0, 0.2 * wide, 2), middle])
        parts += _stem(_wander(rng, foot, head, 0.04 * height), 0.002 + 0.02 * height, 0.001 + 0.006 * height, bark)
    count = int(rng.integers(150, 330))
    spots = rng.normal(size=(count, 3))
    spots /= np.linalg.norm(spots, axis=1, keepdims=True)
    fill = rng.uniform(0.25, 1.0, count) ** 0.5
    cone = float(rng.uniform(-0.4, 0.3))
    spots = spots * fill[:, None]
    spots[:, :2] *= 1.0 - cone * spots[:, 2:]
    base = np.array([0.0, 0.0, middle]) + spots * [wide, wide, crown / 2 * 0.9]
    for tip in base[:9]:
        parts += _stem(
            _wander(rng, np.array([0.0, 0.0, middle - 0.2 * crown]), tip, 0.02 * height, 4),
            0.005 * height,
            0.002 * height,
            bark,
        )
    towards = spots * [1.0, 1.0, 0.6] + rng.normal(0.0, 0.5, (count, 3)) + [0.0, 0.0, float(rng.uniform(-0.4, 0.5))]
    size = height * float(rng.uniform(0.075, 0.14)) * rng.uniform(0.7, 1.2, count)
    shape = str(rng.choice(["oval", "lance", "spoon", "heart"]))
    slim = float(rng.uniform(0.35, 0.75))
    return parts + leaves(base, towards, size, size * slim, foliage(rng), shape, rng.uniform(0.2, 1.2, count), 0.3, 4)


def _stalks(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Broad leaves on long stalks from the soil: monstera, calathea, peace lily, rubber-like; with flowers or not."""
    count = int(rng.integers(11, 30))
    heading, rise = golden(count, rng.uniform(0, 6)), rng.uniform(0.7, 1.45, count)
    size = height * float(rng.uniform(0.32, 0.5)) * rng.uniform(0.7, 1.15, count)
    reach = np.maximum(height * rng.uniform(0.45, 1.0, count) - 0.4 * size, 0.1 * height)
    root = np.column_stack([0.3 * spread * np.cos(heading), 0.3 * spread * np.sin(heading), np.full(count, z)])
    tips = root + ways(heading, rise) * reach[:, None]
    stalk, parts = Material(green(rng)), []
    thin = 0.003 + 0.004 * height
    t = np.linspace(0.0, 1.0, 5)[:, None]
    for low, high in zip(root, tips, strict=True):
        path = low + (high - low) * t + _UP * 0.12 * height * t * (1.0 - t)
        parts += bent(path, np.linspace(thin, thin * 0.6, 5), stalk, 5).parts
    shape, slim = str(rng.choice(["oval", "heart", "heart", "lance", "spoon"])), float(rng.uniform(0.42, 0.9))
    droop = rng.uniform(0.5, 1.4, count)
    parts += leaves(tips, ways(heading, rise - 0.5), size, size * slim, foliage(rng), shape, droop, 0.2, 6)
    if rng.random() < 0.3:
        parts += _blooms(rng, height, z, stalk)
    return parts


def _blooms(rng: np.random.Generator, height: float, z: float, stalk: Material) -> list[Part]:
    """A few flowers of one pointed petal on stalks above the leaves, white or coloured."""
    colour = Material((0.7, 0.7, 0.65) if rng.random() < 0.6 else drawn_colour(rng, 0.9))
    count, parts = int(rng.integers(2, 7)), []
    tips = np.column_stack([rng.normal(0.0, 0.16 * height, (count, 2)), z + height * rng.uniform(0.75, 1.0, count)])
    for tip in tips:
        parts += _stem(_wander(rng, np.array([0.0, 0.0, z]), tip, 0.03 * height, 5), 0.004, 0.003, stalk)
        parts += cushion(tip + [0.0, 0.0, 0.02 * height], np.array([0.02, 0.02, 0.1]) * height, stalk, 2.0).parts
    size = 0.17 * height
    return parts + leaves(tips, ways(golden(count), 0.9), size, 0.6 * size, [colour], "heart", 0.4, 0.5, 5)


def _swords(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Stiff upright blades: sansevieria, agave, aloe."""
    count = int(rng.integers(8, 30))
    heading, out = golden(count, rng.uniform(0, 6)), np.sqrt(np.linspace(0.02, 1.0, count))
    lean = float(rng.uniform(0.1, 0.75))
    root = np.column_stack(
        [out * spread * 0.6 * np.cos(heading), out * spread * 0.6 * np.sin(heading), np.full(count, z)]
    )
    length = height * rng.uniform(0.55, 1.0, count) * (1.0 - 0.2 * out)
    rise = np.pi / 2 - lean * out - np.abs(rng.normal(0.0, 0.06, count))
    width = (0.035 + 0.05 * height) * float(rng.uniform(0.6, 1.3)) * rng.uniform(0.8, 1.2, count)
    droop = rng.normal(0.0, 0.15, count) + float(rng.choice([0.0, 0.0, -0.3, 0.5]))
    return leaves(root - 0.01 * _UP, ways(heading, rise), length, width, foliage(rng, 0.6), "blade", droop, 0.4, 7)


def _fountain(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Many thin leaves that arch over: spider plant, grass, fern."""
    count = int(rng.integers(70, 150))
    heading = golden(count, rng.uniform(0, 6)) + rng.normal(0.0, 0.2, count)
    rise = rng.uniform(0.5, 1.5, count)
    length = height * float(rng.uniform(1.0, 1.5)) * rng.uniform(0.6, 1.0, count)
    root = np.column_stack([rng.normal(0.0, 0.25 * spread, (count, 2)), np.full(count, z - 0.005)])
    droop = float(rng.uniform(1.2, 2.4)) * rng.uniform(0.7, 1.1, count)
    width = height * float(rng.uniform(0.03, 0.08))
    return leaves(root, ways(heading, rise), length, width, foliage(rng, 0.4), "blade", droop, 0.4, 7)


def _rosettes(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Bare canes, each with a tuft of long leaves on top: yucca, dracaena, cordyline."""
    bark, shades, parts = _bark(rng), foliage(rng, 0.35), []
    canes = int(rng.choice([1, 1, 2, 3, 3]))
    long = height * float(rng.uniform(0.28, 0.5))
    arch, slim = float(rng.uniform(0.3, 1.6)), float(rng.uniform(0.06, 0.14))
    for number in range(canes):
        turn = number * 2.1 + rng.uniform(0, 1)
        foot = np.array([np.cos(turn), np.sin(turn), 0.0]) * spread * (0.4 if canes > 1 else 0.05) + z * _UP
        up = max(height * (1.0 - 0.27 * number) - 0.75 * long, 0.08 * height)
        head = foot + up * _UP + rng.normal(0.0, 0.05 * height, 3) * [1, 1, 0]
        parts += _stem(_wander(rng, foot, head, 0.015 * height), 0.012 + 0.016 * height, 0.01 + 0.012 * height, bark)
        count = int(rng.integers(26, 60))
        level = np.linspace(0.0, 1.0, count)
        root = head - np.outer(0.3 * long * (1.0 - level), _UP)
        rise = -0.35 + 1.8 * level + rng.normal(0.0, 0.12, count)
        size = long * rng.uniform(0.75, 1.0, count)
        parts += leaves(
            root, ways(golden(count), rise), size, slim * long, shades, "blade", arch * rng.uniform(0.6, 1.2, count)
        )
    return parts


def _fronds(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A palm or a fern: arching stalks with leaflets on both sides; few broad ones make it a zamioculcas."""
    stalks, pairs = int(rng.integers(9, 16)), int(rng.integers(9, 18))
    heading = golden(stalks, rng.uniform(0, 6))
    rise, arch = rng.uniform(0.85, 1.5, stalks), float(rng.uniform(0.3, 1.3))
    length = height * rng.uniform(0.75, 1.1, stalks)
    material, parts = Material(green(rng)), []
    t = np.linspace(0.0, 1.0, pairs + 4)
    bases, towards, sizes = [], [], []
    fine, forward = height * float(rng.uniform(0.1, 0.22)), float(rng.uniform(0.3, 0.9))
    for turn, up, long in zip(heading, rise, length, strict=True):
        pitch = up - arch * t * rng.uniform(0.7, 1.2)
        steps = ways(np.full(t.shape, turn), pitch) * long / len(t)
        path = (
            np.array([0.3 * spread * np.cos(turn), 0.3 * spread * np.sin(turn), z])
            + np.cumsum(steps, axis=0)
            - steps[0]
        )
        parts += bent(path[::2], np.linspace(0.003 + 0.004 * height, 0.0015, len(path[::2])), material, 4).parts
        grown = np.arange(4, len(t))
        side = np.array([-np.sin(turn), np.cos(turn), 0.0])
        along = steps[grown] / np.linalg.norm(steps[grown], axis=1, keepdims=True)
        share = np.sin(np.pi * (0.12 + 0.8 * (grown - 4) / len(grown)))
        for sign in (-1.0, 1.0):
            bases.append(path[grown])
            towards.append(sign * side + forward * along + 0.15 * _UP)
            sizes.append(fine * share)
    size = np.concatenate(sizes)
    slim, shape = float(rng.uniform(0.18, 0.55)), str(rng.choice(["lance", "oval"]))
    bases, towards = np.concatenate(bases), np.concatenate(towards)
    return parts + leaves(
        bases, towards, size, slim * size, foliage(rng, 0.05), shape, float(rng.uniform(0.0, 0.8)), 0.2, 3
    )


def _cactus(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A ribbed column with arms or brothers, or a ribbed ball."""
    material, ribs = Material(green(rng)), int(rng.integers(7, 16))
    ball = height < 0.25 and rng.random() < 0.5
    parts = _ribbed(
        np.zeros(3) + z * _UP, height, spread * 0.85 if ball else min(spread * 0.6, 0.16 * height), ribs, material
    )
    radius = min(spread * 0.6, 0.16 * height)
    for turn in rng.uniform(0, 6) + np.arange(int(rng.integers(0, 4))) * 2.2 if not ball else ():
        way, at = np.array([np.cos(turn), np.sin(turn), 0.0]), float(rng.uniform(0.25, 0.5)) * height
        elbow = way * radius * 1.9 + (z + at) * _UP
        parts += bent(
            [way * radius * 0.6 + elbow[2] * _UP, elbow - 0.3 * radius * way, elbow + 0.3 * radius * _UP],
            0.4 * radius,
            material,
            9,
        ).parts
        parts += _ribbed(elbow, float(rng.uniform(0.2, 0.4)) * height, 0.5 * radius, ribs, material)
    return parts


def _ribbed(foot: Array, height: float, radius: float, ribs: int, material: Material) -> list[Part]:
    turn, up = np.linspace(0.0, 2.0 * np.pi, 4 * ribs + 1), np.linspace(0.0, 1.0, 14)
    body = np.sqrt(np.maximum(1.0 - np.maximum((up - 0.75) / 0.25, 0.0) ** 2, 0.0)) * (
        0.8 + 0.2 * np.minimum(up * 6, 1)
    )
    if height < 3.0 * radius:
        body = np.sqrt(np.maximum(1.0 - (2.0 * (0.1 + 0.9 * up) - 1.0) ** 2, 0.0))
    around = np.outer(body * radius, 1.0 + 0.12 * np.cos(ribs * turn))
    points = np.stack(
        [around * np.cos(turn), around * np.sin(turn), np.broadcast_to((up * height)[:, None], around.shape)], 2
    )
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normals[:, [0, -1]] = normals[:, [0, -1]] + normals[:, [-1, 0]]
    normals[-1] = _UP
    return [grid(points + foot, normals, material)]


def _bush(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Leaves in a dense ball or cone over the pot, or a ball on a stem; with blossoms or not."""
    stem = height * float(rng.choice([0.0, 0.0, 0.5])) if height > 0.4 else 0.0
    tall = height - stem
    wide = max(tall * float(rng.uniform(0.35, 0.6)), spread)
    middle, parts = z + stem + tall * 0.46, []
    if stem:
        parts += _stem(_wander(rng, z * _UP, middle * _UP, 0.01), 0.012, 0.01, _bark(rng))
    core = np.array([wide * 1.5, wide * 1.5, tall * 0.8])
    shades = foliage(rng, 0.2)
    r, g, b = (0.4 * channel for channel in shades[0].colour)
    parts += cushion(middle * _UP, core, Material((r, g, b)), 2.0).parts
    count = int(rng.integers(220, 350))
    up = np.linspace(-0.95, 1.0, count)
    out = ways(golden(count), np.arcsin(up)) * rng.uniform(0.75, 1.0, (count, 1))
    base = middle * _UP + out * [wide * 0.85, wide * 0.85, tall * 0.48]
    size = (0.02 + 0.1 * tall) * rng.uniform(0.7, 1.3, count)
    shape, slim = str(rng.choice(["oval", "lance", "heart", "spoon"])), float(rng.uniform(0.3, 0.8))
    towards = out + rng.normal(0.0, 0.4, (count, 3)) + 0.3 * _UP
    parts += leaves(base, towards, size, slim * size, shades, shape, rng.uniform(0.0, 1.0, count), 0.25, 4)
    if rng.random() < 0.35:
        petals = Material(drawn_colour(rng, 0.95))
        for spot in out[rng.choice(np.arange(count // 3, count), 10, replace=False)]:
            at = middle * _UP + spot / np.linalg.norm(spot) * [wide * 0.95, wide * 0.95, tall * 0.52]
            turn = golden(6) + float(rng.uniform(0, 6))
            parts += leaves(
                np.repeat(at[None], 6, axis=0),
                ways(turn, 0.5),
                0.3 * size.mean() + 0.012,
                0.02,
                [petals],
                "spoon",
                0.4,
                0.2,
                3,
            )
    return parts


def _orchid(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A few thick leaves at the soil and one to three bowed stems with a row of flowers."""
    stalk, parts = Material(green(rng)), []
    count = int(rng.integers(4, 8))
    size = (0.6 * spread + 0.25 * height) * rng.uniform(0.8, 1.2, count)
    parts += leaves(
        np.repeat(z * _UP[None], count, axis=0),
        ways(golden(count), 0.6),
        size,
        0.4 * size,
        foliage(rng, 0.0),
        "oval",
        1.0,
    )
    r, g, b = (0.7, 0.68, 0.66) if rng.random() < 0.4 else drawn_colour(rng, 0.9)
    petals, heart = Material((r, g, b)), Material(drawn_colour(rng, 0.95))
    for turn in rng.uniform(0, 6) + np.arange(int(rng.choice([1, 2, 2, 3]))) * 2.5:
        way, t = ways(np.array([turn]), 0.0)[0], np.linspace(0.0, 1.0, 12)
        bow = height * float(rng.uniform(0.25, 0.5))
        rise = height * np.sin(t * float(rng.uniform(1.7, 2.1))) * 0.95
        path = np.outer(t**2 * bow, way) + np.outer(z + rise, _UP)
        parts += bent(path, 0.0025 + 0.003 * height, stalk, 5).parts
        for at in path[5:]:
            five, around = golden(5), 2.0 * np.pi * np.arange(5) / 5
            side = np.cross(_UP, way)
            face = np.outer(np.cos(around), _UP) + np.outer(np.sin(around), side) + 0.35 * way
            big = 0.055 * height + 0.012
            centre = at + rng.normal(0.0, 0.02 * height, 3)
            parts += leaves(
                np.repeat(centre[None], len(five), axis=0), face, big, 0.8 * big, [petals], "oval", 0.1, 0.2, 4
            )
            parts += ball(centre + 0.01 * way, 0.35 * big, heart).parts
    return parts


def _succulent(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A rosette of thick pointed leaves close to the soil."""
    count = int(rng.integers(24, 60))
    out = np.linspace(1.0, 0.05, count)
    rise = 1.45 - 1.25 * out
    size = height * (0.5 + 0.5 * out) * float(rng.uniform(0.7, 1.0))
    size = np.minimum(size, 2.2 * spread)
    root = np.repeat(z * _UP[None], count, axis=0) + ways(golden(count), 0.0) * 0.15 * spread * out[:, None]
    shape, slim = str(rng.choice(["spoon", "oval", "blade"])), float(rng.uniform(0.2, 0.5))
    return leaves(root, ways(golden(count), rise), size, slim * size, foliage(rng, 0.3), shape, -0.3, 0.5, 5)


def _bamboo(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Upright canes with knots, each with a few leaves: lucky bamboo, rubber plant, dieffenbachia."""
    count, material, shades, parts = int(rng.integers(3, 8)), Material(green(rng)), foliage(rng), []
    leafy, slim = int(rng.integers(9, 16)), float(rng.uniform(0.15, 0.5))
    big, shape = height * float(rng.uniform(0.2, 0.36)), str(rng.choice(["lance", "oval"]))
    start = float(rng.uniform(0.1, 0.75))
    for turn in golden(count):
        foot = np.array([np.cos(turn), np.sin(turn), 0.0]) * spread * 0.5 + z * _UP
        head = foot * [1.5, 1.5, 1.0] + height * float(rng.uniform(0.55, 0.85)) * _UP
        path = _wander(rng, foot, head, 0.02 * height, 9)
        radius = (0.004 + 0.01 * height) * np.where(np.arange(9) % 2, 1.0, 1.15)
        parts += bent(path, radius, material, 6).parts
        level = np.linspace(start, 1.0, leafy)
        base = np.stack([np.interp(level * 8, np.arange(9), path[:, i]) for i in range(3)], axis=1)
        towards = ways(golden(leafy, turn), 0.3 + 0.9 * level)
        parts += leaves(base, towards, big, slim * big, shades, shape, rng.uniform(0.3, 1.3, leafy), 0.25, 6)
    return parts


# What grows on the floor, and how high with its pot, metres.
_FLOOR: tuple[tuple[Growth, float, float], ...] = (
    (_tree, 0.8, 1.7), (_tree, 0.8, 1.7), (_stalks, 0.5, 1.3), (_stalks, 0.4, 1.1), (_swords, 0.45, 1.1),
    (_rosettes, 0.7, 1.7), (_fronds, 0.7, 1.7), (_fountain, 0.4, 0.8), (_cactus, 0.5, 1.3), (_bush, 0.45, 1.2),
    (_bamboo, 0.7, 1.6), (_orchid, 0.5, 0.8),
)  # fmt: skip
_SMALL: tuple[Growth, ...] = (
    _cactus, _succulent, _succulent, _orchid, _swords, _fountain, _bush, _stalks, _bamboo, _tree, _fronds,
)  # fmt: skip
