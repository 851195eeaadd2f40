"""Plants of leaves, fronds and flowers from the soil, and cacti."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import drawn_colour
from edgemap.simulation.apartment.made.plants.leaves import foliage, golden, green, leaves, ways
from edgemap.simulation.apartment.made.plants.woody import stem, wander
from edgemap.simulation.apartment.made.shapes.bars import rod
from edgemap.simulation.apartment.made.shapes.grids import surface
from edgemap.simulation.apartment.made.shapes.solids import ball, cushion
from edgemap.simulation.render.mesh import Array, Material, Part

_UP = np.array([0.0, 0.0, 1.0])


def stalks(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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
        parts += rod(path, np.linspace(thin, thin * 0.6, 5), stalk, sides=5, ends=False).parts
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
        parts += stem(wander(rng, np.array([0.0, 0.0, z]), tip, 0.03 * height, 5), 0.004, 0.003, stalk)
        parts += cushion(tip + [0.0, 0.0, 0.02 * height], np.array([0.02, 0.02, 0.1]) * height, stalk, 2.0).parts
    size = 0.17 * height
    return parts + leaves(tips, ways(golden(count), 0.9), size, 0.6 * size, [colour], "heart", 0.4, 0.5, 5)


def swords(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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


def fountain(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """Many thin leaves that arch over: spider plant, grass, fern."""
    count = int(rng.integers(70, 150))
    heading = golden(count, rng.uniform(0, 6)) + rng.normal(0.0, 0.2, count)
    rise = rng.uniform(0.5, 1.5, count)
    length = height * float(rng.uniform(1.0, 1.5)) * rng.uniform(0.6, 1.0, count)
    root = np.column_stack([rng.normal(0.0, 0.25 * spread, (count, 2)), np.full(count, z - 0.005)])
    droop = float(rng.uniform(1.2, 2.4)) * rng.uniform(0.7, 1.1, count)
    width = height * float(rng.uniform(0.03, 0.08))
    return leaves(root, ways(heading, rise), length, width, foliage(rng, 0.4), "blade", droop, 0.4, 7)


def fronds(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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
        parts += rod(
            path[::2], np.linspace(0.003 + 0.004 * height, 0.0015, len(path[::2])), material, sides=4, ends=False
        ).parts
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


def cactus(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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
        parts += rod(
            [way * radius * 0.6 + elbow[2] * _UP, elbow - 0.3 * radius * way, elbow + 0.3 * radius * _UP],
            0.4 * radius,
            material,
            sides=9,
            ends=False,
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
    return [surface(points + foot, material, round_=True)]


def orchid(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
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
        parts += rod(path, 0.0025 + 0.003 * height, stalk, sides=5, ends=False).parts
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


def succulent(rng: np.random.Generator, height: float, spread: float, z: float) -> list[Part]:
    """A rosette of thick pointed leaves close to the soil."""
    count = int(rng.integers(24, 60))
    out = np.linspace(1.0, 0.05, count)
    rise = 1.45 - 1.25 * out
    size = height * (0.5 + 0.5 * out) * float(rng.uniform(0.7, 1.0))
    size = np.minimum(size, 2.2 * spread)
    root = np.repeat(z * _UP[None], count, axis=0) + ways(golden(count), 0.0) * 0.15 * spread * out[:, None]
    shape, slim = str(rng.choice(["spoon", "oval", "blade"])), float(rng.uniform(0.2, 0.5))
    return leaves(root, ways(golden(count), rise), size, slim * size, foliage(rng, 0.3), shape, -0.3, 0.5, 5)
