"""Backs of chairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.materials.cloths import woven
from edgemap.simulation.apartment.made.shapes.bars import bar, beam, rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import sheet
from edgemap.simulation.render.mesh import Array, Material, Mesh


@dataclass(frozen=True, slots=True)
class Back:
    """A leaning, bowed surface: x of its foot, heights of foot (low) and top (high), widths at both.

    lean: rearwards per metre of height. bow: how far its middle lies behind its sides.
    """

    x: float
    low: float
    high: float
    width: float
    top_width: float
    lean: float
    bow: float

    def at(self, across: ArrayLike, up: ArrayLike) -> Array:
        """Points (..., 3) from -1 (right) to 1 (left), and from 0 (low) to 1 (high)."""
        across, up = np.broadcast_arrays(np.asarray(across, dtype=np.float64), np.asarray(up, dtype=np.float64))
        rise = up * (self.high - self.low)
        half = (self.width + (self.top_width - self.width) * up) / 2.0
        x = self.x - self.lean * rise - self.bow * (1.0 - across**2)
        return np.stack([x, across * half, self.low + rise], axis=-1)

    def strip(
        self, left: ArrayLike, up: ArrayLike, thickness: float | Array, material: Material, columns: int = 9
    ) -> Mesh:
        """A sheet whose rows (R,) at `up` reach from -left to left (R,)."""
        left, up = np.broadcast_arrays(np.asarray(left, dtype=np.float64), np.asarray(up, dtype=np.float64))
        across = np.linspace(-1.0, 1.0, columns) * left[:, None]
        return sheet(self.at(across, up[:, None]), thickness, material)

    def posts(self, radius: float, material: Material, round_: bool) -> list[Mesh]:
        """Both side posts."""
        meshes = []
        for side in (1.0, -1.0):
            foot, top = self.at(side, 0.0) - [0.0, 0.0, 0.02], self.at(side, 1.0)
            if round_:
                meshes.append(tube(foot, top, radius, material, radius * 0.8))
            else:
                meshes.append(beam(foot, top, (1.7 * radius, 2.0 * radius), material, 0.85))
        return meshes


def rails(rng: np.random.Generator, back: Back, wood: Material, cover: Material) -> list[Mesh]:
    """What is between two posts: slats, bars, a splat, a cross, a board or a padded board."""
    thin = float(rng.uniform(0.012, 0.02))
    tall = back.high - back.low
    crest = float(rng.uniform(0.05, 0.11)) / tall
    way = str(rng.choice(["ladder", "ladder", "slats", "slats", "bars", "splat", "cross", "board", "padded", "padded"]))
    arch = float(rng.choice([0.0, rng.uniform(0.02, 0.08)]))
    rows = np.linspace(1.0 - crest, 1.0, 3)
    top = back.at(np.linspace(-1.0, 1.0, 11), rows[:, None])
    top[..., 2] += arch * np.cos(np.linspace(-1.0, 1.0, 11) * np.pi / 2.0) * np.array([[0.4], [0.7], [1.0]])
    low = float(rng.uniform(0.15, 0.4))
    meshes = [sheet(top, thin * 1.3, wood)] if way not in ("board", "padded") or rng.random() < 0.3 else []
    if way == "ladder":
        count = int(rng.integers(1, 5))
        high = float(rng.uniform(0.3, 0.65)) * (1.0 - crest - low) / count
        for at in np.linspace(low, 1.0 - crest, count + 1)[:-1]:
            meshes.append(back.strip(1.0, np.linspace(at, at + high, 2), thin, wood))
    elif way in ("slats", "bars", "splat", "cross"):
        foot = low if rng.random() < 0.7 else 0.02
        meshes.append(back.strip(1.0, [foot, foot + 0.035 / tall], thin, wood))
        meshes += _uprights(rng, way, back, (foot + 0.01, 1.0 - crest + 0.02), thin, wood)
    else:
        foot, end = float(rng.choice([0.03, rng.uniform(0.2, 0.5)])), 1.0 - crest if meshes else 1.0
        up = np.linspace(foot, end, 7)
        padding = np.full((7, 9), thin) if way == "board" else _padding(7, 9, float(rng.uniform(0.03, 0.06)))
        meshes.append(back.strip(1.0 if way == "board" else 0.96, up, padding, wood if way == "board" else cover))
    return meshes


def _uprights(
    rng: np.random.Generator, way: str, back: Back, span: tuple[float, float], thin: float, wood: Material
) -> list[Mesh]:
    low, high = span
    if way == "cross":
        bow = np.linspace(-1.0, 1.0, 9)
        up = np.linspace(low, high, 9)
        shape = bow if rng.random() < 0.5 else np.sin(bow * np.pi / 2.0)
        return [rod(back.at(side * 0.95 * shape, up), thin, wood, 0.6, 6) for side in (1.0, -1.0)]
    if way == "splat":
        up = np.linspace(low, high, 13)
        share = np.linspace(0.0, 1.0, 13)
        wide = float(rng.uniform(0.2, 0.4))
        shape = wide * (
            1.0 + float(rng.uniform(0.0, 0.45)) * np.sin(share * np.pi * float(rng.choice([1.0, 2.0, 3.0])))
        )
        return [back.strip(shape, up, thin * 0.8, wood, 3)]
    count = int(rng.integers(3, 9)) if way == "slats" else int(rng.integers(4, 10))
    wide = float(rng.uniform(0.25, 0.6)) / count
    meshes = []
    for across in np.linspace(-1.0, 1.0, count + 2)[1:-1]:
        if way == "bars":
            meshes.append(bar(back.at(across, low), back.at(across, high), 0.007, wood, 0.03))
        else:
            edges = across + np.array([-wide, wide])
            meshes.append(sheet(back.at(edges, np.linspace(low, high, 2)[:, None]), thin * 0.8, wood))
    return meshes


def hoop(rng: np.random.Generator, back: Back, wood: Material, radius: float, filling: str) -> list[Mesh]:
    """A bent hoop from one side over the top to the other: round spindles, a second hoop, a board or cane within."""
    turn, square = np.linspace(0.0, np.pi, 21), float(rng.uniform(2.0, 3.5))
    across = -np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** (2.0 / square)
    up = np.sin(turn) ** (2.0 / square)
    path = back.at(across, up)
    path[[0, -1], 2] -= 0.02
    meshes = [rod(path, radius, wood)]
    if filling == "spindles":
        count = int(rng.integers(5, 10))
        for at in np.linspace(-0.85, 0.85, count):
            top = (1.0 - abs(at) ** square) ** (1.0 / square)
            foot = back.at(at * 0.8, -0.02)
            meshes.append(
                rod(
                    np.linspace(foot, back.at(at, top), 5), radius * np.array([0.5, 0.6, 0.75, 0.6, 0.5]), wood, sides=6
                )
            )
    elif filling == "hoop":
        share = float(rng.uniform(0.55, 0.7))
        meshes.append(rod(back.at(across * share, up * float(rng.uniform(0.75, 0.88))), radius * 0.75, wood))
    else:
        rows = np.linspace(float(rng.uniform(0.02, 0.35)), 0.985, 10)
        left = (1.0 - rows**square) ** (1.0 / square)
        meshes.append(back.strip(np.maximum(left, 0.1), rows, 0.008, wood if filling == "board" else woven(rng)))
    return meshes


def upholstered(
    back: Back, thickness: float, cover: Material, squareness: float, behind: Material | None = None
) -> Mesh:
    """A padded back of its own outline: rounded above and below as much as squareness (2 to 10) says."""
    rows, columns = 11, 11
    level = np.sin(np.linspace(-1.0, 1.0, rows) * np.pi / 2.0)
    left = np.maximum((1.0 - np.abs(level) ** squareness) ** (1.0 / squareness), 0.45 if squareness < 5 else 0.75)
    across = np.sin(np.linspace(-1.0, 1.0, columns) * np.pi / 2.0) * left[:, None]
    surface = back.at(across, ((level + 1.0) / 2.0)[:, None])
    return sheet(surface, _padding(rows, columns, thickness), cover, behind)


def _padding(rows: int, columns: int, thickness: float) -> Array:
    """Full in the middle, thinner at the edges, (rows, columns)."""
    v, u = np.linspace(-1.0, 1.0, rows)[:, None], np.linspace(-1.0, 1.0, columns)
    return thickness * (0.35 + 0.65 * np.sqrt((1.0 - u**6) * (1.0 - v**6)))
