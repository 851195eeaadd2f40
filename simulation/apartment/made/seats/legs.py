"""What seats stand on."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK
from edgemap.simulation.apartment.made.seats.seat import Seat
from edgemap.simulation.apartment.made.shapes.bars import bar, beam, rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import lathe, pad
from edgemap.simulation.apartment.made.shapes.outlines import filleted, oval
from edgemap.simulation.render.mesh import Array, Material, Mesh

# Joiners' ways of one leg; stools leave the last two.
WAYS = ("square", "square", "tapered", "tapered", "round", "dowel", "turned", "sabre")


def leg(way: str, top: Array, foot: Array, radius: float, material: Material) -> Mesh:
    """One leg: square, tapered, round, dowel (round and tapered), turned or sabre."""
    if way in ("square", "tapered"):
        return beam(top, foot, (2.0 * radius, 2.0 * radius), material, taper=0.55 if way == "tapered" else 1.0)
    if way == "turned":
        at = np.array([0.0, 0.12, 0.15, 0.2, 0.24, 0.3, 0.5, 0.62, 0.66, 0.7, 0.75, 0.9, 1.0])
        swell = np.array([0.8, 0.8, 1.15, 1.15, 0.7, 0.85, 1.15, 0.95, 0.65, 1.15, 0.75, 0.7, 0.55])
        return rod(top + at[:, None] * (foot - top), swell * radius, material)
    if way == "sabre":
        at = np.linspace(0.0, 1.0, 7)
        bow = np.array([1.0, 0.3, 0.0]) * np.sign(top) * 0.05
        path = top + at[:, None] * (foot - top) + (at * (at - 0.55) * 2.0)[:, None] * bow
        return rod(path, radius * (1.1 - 0.45 * at), material, sides=6)
    return tube(top, foot, radius, material, end_radius=radius * 0.6 if way == "dowel" else None)


def stretchers(way: str, tops: Array, feet: Array, radius: float, height: float, material: Material) -> list[Mesh]:
    """Bars between four legs at a height: none, an H, a box, at the sides only, or crossed."""
    share = (tops[:, 2:] - height) / (tops[:, 2:] - feet[:, 2:])
    a, b, c, d = tops + share * (feet - tops)
    rise = np.array([0.0, 0.0, 0.05])
    runs = {
        "H": [(a, c), (b, d), ((a + c) / 2.0, (b + d) / 2.0)],
        "box": [(a, c), (b, d), (a + rise, b + rise), (c + rise, d + rise)],
        "sides": [(a, c), (b, d)],
        "cross": [(a, d), (b, c)],
    }
    return [bar(start, end, radius, material, 2.5 * radius) for start, end in runs.get(way, [])]


def four_legs(
    rng: np.random.Generator, seat: Seat, way: str, splay: float, radius: float, material: Material
) -> list[Mesh]:
    """Four legs, splayed outwards by a distance, with or without stretchers."""
    tops = seat.corners(0.005 + radius)
    feet = tops + np.sign(tops) * [splay, splay * float(rng.uniform(0.4, 1.0)), 0.0]
    feet[:, 2] = 0.0
    meshes = [leg(way, top, foot, radius, material) for top, foot in zip(tops, feet, strict=True)]
    bars = str(rng.choice(["none", "none", "H", "box", "sides", "cross"]))
    height = seat.under * float(rng.uniform(0.25, 0.5))
    return meshes + stretchers(bars, tops, feet, radius * 0.6, height, material)


def tubular(rng: np.random.Generator, seat: Seat, material: Material) -> list[Mesh]:
    """A frame of bent steel tube: four legs, a sled on each side, or a cantilever."""
    way, radius = str(rng.choice(["four", "sled", "cantilever", "hairpin"])), float(rng.uniform(0.008, 0.013))
    x, y, z = seat.depth / 2.0, min(seat.front, seat.back) / 2.0 - radius, seat.under - radius
    if way == "four":
        out = float(rng.uniform(0.0, 0.05))
        loops = [
            [(at + s * out, y + out, 0.0), (at, y, z), (at, -y, z), (at + s * out, -y - out, 0.0)]
            for s, at in ((1, x - 0.04), (-1, 0.04 - x))
        ]
        sides = [tube((x - 0.04, s * y, z), (0.04 - x, s * y, z), radius, material) for s in (1, -1)]
        return [rod(filleted(loop, 0.06), radius, material) for loop in loops] + sides
    if way == "sled":
        rail = tube((0.0, y, z), (0.0, -y, z), radius, material)
        slope = float(rng.uniform(0.0, 0.06))
        loop = np.array([(x - 0.05, 0, z), (x - 0.05 + slope, 0, radius), (-x, 0, radius), (0.05 - x, 0, z)])
        return [rail] + [rod(filleted(loop + [0, s * y, 0], 0.07, closed=True), radius, material) for s in (1, -1)]
    if way == "cantilever":
        half = [(-x, y, z), (x, y, z), (x + 0.02, y, radius), (-x, y, radius)]
        return [rod(filleted(half + [(a, -b, c) for a, b, c in half[::-1]], 0.08), radius * 1.2, material)]
    meshes = []
    for top in seat.corners(0.05):
        out = np.sign(top) * [0.04, 0.04, 0.0]
        foot = np.array([top[0], top[1], 0.006]) + out
        spread = np.array([-0.05 * np.sign(top[0]), 0.0, 0.0])
        for end in (top + spread, top - 0.8 * np.sign(top) * [0.0, 0.06, 0.0]):
            meshes.append(tube(end, foot, 0.006, material))
    return meshes


def pedestal(rng: np.random.Generator, height: float, material: Material, foot: float) -> list[Mesh]:
    """One foot: a column on a disc, or a trumpet."""
    if rng.random() < 0.5:
        column, thick = float(rng.uniform(0.02, 0.035)), float(rng.uniform(0.008, 0.02))
        disc = pad(oval(2.0 * foot, 2.0 * foot), 0.0, thick, material, 0.01)
        return [disc, tube((0.0, 0.0, thick), (0.0, 0.0, height), column, material)]
    up = np.linspace(0.0, 1.0, 12)
    radii = 0.03 + (foot - 0.03) * (1.0 - up) ** 4 + 0.05 * up**8
    return [Mesh((lathe(radii, up * height, material, 20),))]


def star(rng: np.random.Generator, height: float, material: Material, castors: bool) -> list[Mesh]:
    """A star foot of four or five spokes with a gas lift, on castors or on glides."""
    spokes, reach = (5 if castors or rng.random() < 0.4 else 4), float(rng.uniform(0.27, 0.34))
    low, hub = (0.065, 0.1) if castors else (0.015, float(rng.uniform(0.05, 0.09)))
    meshes = [tube((0, 0, hub - 0.03), (0, 0, height * 0.6), 0.026, BLACK if castors else material)]
    meshes += [
        tube((0, 0, height * 0.55), (0, 0, height), 0.015, material),
        tube((0, 0, low), (0, 0, hub), 0.04, material),
    ]
    for turn in 2.0 * np.pi * np.arange(spokes) / spokes + float(rng.uniform(0.0, 1.0)):
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        side = (float(-out[1]), float(out[0]), 0.0)
        end = out * reach + [0, 0, low]
        meshes.append(beam((0, 0, hub - 0.015), end, (0.05, 0.03), material, 0.6, side))
        if castors:
            roll = np.array([0.012, 0.0, 0.0]) if rng.random() < 0.5 else np.array([0.0, 0.012, 0.0])
            for side_ in (1.0, -1.0):
                middle = out * reach + [0.0, 0.0, 0.027]
                meshes.append(tube(middle + side_ * roll * 0.3, middle + side_ * roll * 2.0, 0.027, BLACK))
            meshes.append(tube(out * reach + [0, 0, 0.03], end, 0.009, BLACK))
        else:
            meshes.append(tube(out * (reach - 0.02), end - out * 0.02, 0.015, BLACK))
    return meshes
