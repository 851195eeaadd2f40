"""Plants with stems of wood: trees, canes with tufts, bushes."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import drawn_colour
from edgemap.simulation.apartment.made.plants.leaves import foliage, golden, green, leaves, ways
from edgemap.simulation.apartment.made.shapes.bars import rod
from edgemap.simulation.apartment.made.shapes.solids import cushion
from edgemap.simulation.render.mesh import Array, Material, Part

_UP = np.array([0.0, 0.0, 1.0])


def _bark(rng: np.random.Generator) -> Material:
    value = float(rng.uniform(0.04, 0.25))
    return Material((value, value * float(rng.uniform(0.65, 0.9)), value * float(rng.uniform(0.35, 0.7))))


def stem(path: Array, radius: float, end: float, material: Material) -> list[Part]:
    """A stem along points (N, 3), its radius running from one to another, metres."""
    return list(rod(path, np.linspace(radius, end, len(path)), material, sides=6, ends=False).parts)


def wander(rng: np.random.Generator, start: Array, end: Array, bow: float, points: int = 7) -> Array:
    """A path that bows and wavers between two points (3,)."""
    t = np.linspace(0.0, 1.0, points)[:, None]
    aside = rng.normal(0.0, bow, 3) * [1.0, 1.0, 0.2]
    other = rng.normal(0.0, 0.4 * bow, 3) * [1.0, 1.0, 0.1]
    return start + (end - start) * t + aside * np.sin(np.pi * t) + other * np.sin(2.0 * np.pi * t)


def tree(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A ficus: one to three trunks, branches, and a crown of small leaves, round, egg-shaped or loose."""
    bark, start = _bark(rng), np.array([0.0, 0.0, z])
    crown = float(rng.uniform(0.45, 0.85)) * height
    wide = height * float(rng.uniform(0.18, 0.34))
    middle = z + height - crown / 2
    parts: list[Part] = []
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        foot = start + rng.normal(0.0, 0.15 * spread, 3) * [1, 1, 0]
        head = np.array([*rng.normal(0.0, 0.2 * wide, 2), middle])
        parts += stem(wander(rng, foot, head, 0.04 * height), 0.002 + 0.02 * height, 0.001 + 0.006 * height, bark)
    count = int(rng.integers(150, 330))
    spots = rng.normal(size=(count, 3))
    spots /= np.linalg.norm(spots, axis=1, keepdims=True)
    fill = rng.uniform(0.25, 1.0, count) ** 0.5
    cone = float(rng.uniform(-0.4, 0.3))
    spots = spots * fill[:, None]
    spots[:, :2] *= 1.0 - cone * spots[:, 2:]
    base = np.array([0.0, 0.0, middle]) + spots * [wide, wide, crown / 2 * 0.9]
    for tip in base[:9]:
        parts += stem(
            wander(rng, np.array([0.0, 0.0, middle - 0.2 * crown]), tip, 0.02 * height, 4),
            0.005 * height,
            0.002 * height,
            bark,
        )
    towards = spots * [1.0, 1.0, 0.6] + rng.normal(0.0, 0.5, (count, 3)) + [0.0, 0.0, float(rng.uniform(-0.4, 0.5))]
    size = height * float(rng.uniform(0.075, 0.14)) * rng.uniform(0.7, 1.2, count)
    shape = str(rng.choice(["oval", "lance", "spoon", "heart"]))
    slim = float(rng.uniform(0.35, 0.75))
    return parts + leaves(base, towards, size, size * slim, foliage(rng), shape, rng.uniform(0.2, 1.2, count), 0.3, 4)


def rosettes(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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
        parts += stem(wander(rng, foot, head, 0.015 * height), 0.012 + 0.016 * height, 0.01 + 0.012 * height, bark)
        count = int(rng.integers(26, 60))
        level = np.linspace(0.0, 1.0, count)
        root = head - np.outer(0.3 * long * (1.0 - level), _UP)
        rise = -0.35 + 1.8 * level + rng.normal(0.0, 0.12, count)
        size = long * rng.uniform(0.75, 1.0, count)
        parts += leaves(
            root, ways(golden(count), rise), size, slim * long, shades, "blade", arch * rng.uniform(0.6, 1.2, count)
        )
    return parts


def bamboo(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Upright canes with knots, each with a few leaves: lucky bamboo, rubber plant, dieffenbachia."""
    count, material, shades, parts = int(rng.integers(3, 8)), Material(green(rng)), foliage(rng), []
    leafy, slim = int(rng.integers(9, 16)), float(rng.uniform(0.15, 0.5))
    big, shape = height * float(rng.uniform(0.2, 0.36)), str(rng.choice(["lance", "oval"]))
    start = float(rng.uniform(0.1, 0.75))
    for turn in golden(count):
        foot = np.array([np.cos(turn), np.sin(turn), 0.0]) * spread * 0.5 + z * _UP
        head = foot * [1.5, 1.5, 1.0] + height * float(rng.uniform(0.55, 0.85)) * _UP
        path = wander(rng, foot, head, 0.02 * height, 9)
        radius = (0.004 + 0.01 * height) * np.where(np.arange(9) % 2, 1.0, 1.15)
        parts += rod(path, radius, material, sides=6, ends=False).parts
        level = np.linspace(start, 1.0, leafy)
        base = np.stack([np.interp(level * 8, np.arange(9), path[:, i]) for i in range(3)], axis=1)
        towards = ways(golden(leafy, turn), 0.3 + 0.9 * level)
        parts += leaves(base, towards, big, slim * big, shades, shape, rng.uniform(0.3, 1.3, leafy), 0.25, 6)
    return parts


def bush(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Leaves in a dense ball or cone over the pot, or a ball on a stem; with blossoms or not."""
    bare = height * float(rng.choice([0.0, 0.0, 0.5])) if height > 0.4 else 0.0
    tall = height - bare
    wide = max(tall * float(rng.uniform(0.35, 0.6)), spread)
    middle, parts = z + bare + tall * 0.46, []
    if bare:
        parts += stem(wander(rng, z * _UP, middle * _UP, 0.01), 0.012, 0.01, _bark(rng))
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
