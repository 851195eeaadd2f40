"""Refrigerators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.materials.finishes import finish
from edgemap.simulation.apartment.made.materials.plain import BLACK, CHROME, GLASS, RUBBER, STEEL, drawn_colour
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.outlines import arc
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, rounded
from edgemap.simulation.render.mesh import Material, Mesh, box

_FRIDGES = (0.12, 0.13, 0.2, 0.24, 0.11, 0.08, 0.12)
_Door = tuple[float, float, float, float, int]


def refrigerator(rng: np.random.Generator) -> Mesh:
    """A cabinet on a plinth with thick doors before it: one, two or three, side by side or one above the other.

    Between them dark seams; on them handles, a badge, a display, an ice dispenser, notes.
    """
    build = str(rng.choice(["small", "one", "top", "bottom", "sides", "french", "retro"], p=_FRIDGES))
    tall = {"small": (0.82, 1.0), "one": (1.1, 1.9), "retro": (0.95, 1.9), "top": (1.35, 1.85)}.get(build, (1.65, 2.02))
    height = float(rng.uniform(*tall))
    wide = {"sides": (0.82, 0.95), "french": (0.75, 0.95), "small": (0.45, 0.6)}.get(build, (0.52, 0.72))
    width, depth = float(rng.uniform(*wide)), float(rng.uniform(0.48, 0.62))
    door = float(rng.uniform(0.045, 0.085))
    front = finish(rng, 0.75 if build == "retro" else 0.12)
    steel = front.texture is not None
    sides = Material((0.12, 0.12, 0.125), gloss=0.15) if steel and rng.random() < 0.6 else front
    if steel and sides is front:
        sides = Material((0.3, 0.3, 0.31), gloss=0.2)
    radius = float(rng.uniform(0.05, 0.1)) if build == "retro" else float(rng.uniform(0.003, 0.02))
    foot = float(rng.uniform(0.03, 0.1))
    half, gap = width / 2.0, float(rng.uniform(0.006, 0.014))
    rubber = Material((0.2, 0.2, 0.2)) if max(front.colour) < 0.08 else RUBBER
    meshes = [
        rounded((0.0, -half, foot), (depth, half, height), sides, radius, min(radius, 0.01), axis=0),
        box((0.03, -half + 0.02, 0.0), (depth - 0.03, half - 0.02, foot + 0.001), BLACK),
        # The seal: dark, and a little smaller than the doors.
        rounded(
            (depth - 0.01, -half + 0.008, foot + 0.008),
            (depth + gap, half - 0.008, height - 0.008),
            rubber,
            radius,
            0.002,
            axis=0,
        ),
    ]
    low, inset = foot + 0.004, 0.001
    doors = _doors(rng, build, half - inset, low, height)
    edge = float(rng.uniform(0.02, 0.035)) if build == "retro" else float(rng.uniform(0.002, 0.014))
    face = depth + gap + door
    handle = _handle_maker(rng, build, front)
    right = rng.random() < 0.5
    for y0, y1, z0, z1, opens in doors:
        corner = radius if build == "retro" else max(radius, 0.004)
        meshes.append(rounded((depth + gap, y0, z0), (face, y1, z1), front, corner, edge, axis=0))
        hand = (-1 if right else 1) if opens == 0 else opens
        meshes.append(handle(face, (y0, y1, z0, z1), hand, len(doors)))
    meshes.append(_trim(rng, build, face, doors))
    if rng.random() < 0.5 and build != "retro":
        hinge = -half + 0.05 if not right else half - 0.05
        for y in {hinge, -hinge} if build in {"sides", "french"} else {hinge}:
            meshes.append(block(depth, y, height - 0.001, 0.09, 0.06, 0.016, sides if sides is not front else BLACK))
    return joined(meshes)


def _doors(rng: np.random.Generator, build: str, half: float, low: float, high: float) -> list[_Door]:
    """Doors from right to left and bottom to top: y0, y1, z0, z1 and the side of the handle (0 either, 2 across)."""
    seam, tall = float(rng.uniform(0.004, 0.009)), high - low
    if build == "sides":
        split = float(rng.uniform(-0.02, 0.16)) * half
        return [(-half, split - seam, low, high, 1), (split + seam, half, low, high, -1)]
    if build == "french":
        cuts = [low + tall * float(rng.uniform(0.32, 0.42))]
        if rng.random() < 0.4:
            cuts = [low + tall * 0.25, low + tall * 0.45]
        drawers = [(-half, half, z0 + seam, z1 - seam, 2) for z0, z1 in zip([low, *cuts[:-1]], cuts, strict=True)]
        top = cuts[-1] + seam
        return [*drawers, (-half, -seam, top, high, 1), (seam, half, top, high, -1)]
    if build in {"small", "one"} or (build == "retro" and rng.random() < 0.5):
        return [(-half, half, low, high, 0)]
    share = float(rng.uniform(0.28, 0.43)) if build == "bottom" else float(rng.uniform(0.58, 0.74))
    cut = low + tall * share
    return [(-half, half, low, cut - seam, 0), (-half, half, cut + seam, high, 0)]


def _handle_maker(rng: np.random.Generator, build: str, front: Material) -> Callable[..., Mesh]:
    """One way of handles for all doors of one refrigerator."""
    ways = ["bar", "bow", "slot", "flat", "groove"]
    way = "lever" if build == "retro" and rng.random() < 0.7 else str(rng.choice(ways, p=[0.35, 0.2, 0.2, 0.15, 0.1]))
    material = (CHROME, STEEL, BLACK, front)[int(rng.choice(4, p=[0.3, 0.3, 0.15, 0.25]))]
    dark = max(front.colour) < 0.08
    if dark and rng.random() < 0.8:
        # A black door without a bright handle tells nobody what it is.
        way, material = str(rng.choice(["bar", "bow", "flat"])), CHROME
    if way == "lever":
        material = CHROME
    share, off = float(rng.uniform(0.25, 0.85)), float(rng.uniform(0.035, 0.06))
    away, thick = float(rng.uniform(0.03, 0.05)), float(rng.uniform(0.008, 0.014))

    def handle(face: float, door: tuple[float, float, float, float], side: int, count: int) -> Mesh:
        y0, y1, z0, z1 = door
        if side == 2:
            z, y, long = z1 - off, (y0 + y1) / 2.0, (y1 - y0) * max(share, 0.5)
            ends = np.array([[face, y - long / 2.0, z], [face, y + long / 2.0, z]])
        else:
            y, long = (y1 - off if side > 0 else y0 + off), min((z1 - z0) * share, 0.85)
            # Handles of doors one above the other meet where the doors do; a tall door's is at hand height.
            if count > 1 and z1 < 1.2 and z0 < 0.2:
                z_low = z1 - 0.04 - long
            elif count > 1 and z0 > 0.5:
                z_low = z0 + 0.04
            else:
                z_low = min(max(0.95 - long / 2.0, z0 + 0.05), z1 - long - 0.05)
            ends = np.array([[face, y, z_low], [face, y, z_low + long]])
        out = np.array([1.0, 0.0, 0.0])
        line = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        if way == "bar":
            posts = [ends[0] + line * 0.04, ends[1] - line * 0.04]
            bar = tube(ends[0] + out * away, ends[1] + out * away, thick, material)
            return joined([bar, *(tube(p, p + out * away, thick * 0.8, material) for p in posts)])
        if way == "bow":
            bow = arc(ends[0] - out * 0.004, ends[1] - out * 0.004, out * (away + 0.012), 13)
            return rod(bow, thick * 1.4, material, 1.0 / 1.4, across=np.cross(out, line))
        if way == "lever":
            ends[1] = ends[0] + line * min(long, 0.24)
            middle = (ends[0] + ends[1]) / 2.0
            lever = rounded(middle + [0.02, -0.014, -0.12], middle + [0.042, 0.014, 0.12], material, 0.01, 0.008)
            if side == 2:
                lever = rounded(middle + [0.02, -0.12, -0.014], middle + [0.042, 0.12, 0.014], material, 0.01, 0.008, 1)
            return joined([lever, block(middle[0] + 0.012, middle[1], middle[2] - 0.03, 0.03, 0.03, 0.06, material)])
        size = np.where(line != 0.0, np.abs(ends[1] - ends[0]), 0.034)
        middle = (ends[0] + ends[1]) / 2.0
        if way == "slot":
            low, high = middle - size / 2.0, middle + size / 2.0
            low[0], high[0] = face - 0.01, face + 0.0015
            return box(low, high, RUBBER)
        if way == "groove":
            # No handle but a dark groove along the whole edge.
            if side == 2:
                return box((face - 0.02, y0 + 0.004, z1 - 0.022), (face + 0.001, y1 - 0.004, z1 - 0.004), RUBBER)
            edge = y1 - 0.016 if side > 0 else y0 + 0.003
            return box((face - 0.02, edge, z0 + 0.02), (face + 0.001, edge + 0.013, z1 - 0.02), RUBBER)
        low, high = middle - size * 0.5, middle + size * 0.5
        low[0], high[0] = face - 0.002, face + 0.03
        return rounded(low, high, material, 0.012, 0.008, axis=1 if side == 2 else 2)

    return handle


def _trim(rng: np.random.Generator, build: str, face: float, doors: list[_Door]) -> Mesh:
    """What is on the doors: a badge, a display or an ice dispenser, notes and pictures held by magnets."""
    meshes = []
    y0, y1, z0, z1, _ = doors[-1]
    if rng.random() < 0.7:
        wide, tall = float(rng.uniform(0.05, 0.11)), float(rng.uniform(0.01, 0.02))
        y = (y0 + y1) / 2.0 if rng.random() < 0.5 else y0 + 0.04 + wide / 2.0
        if build == "retro":
            wide *= 1.8
        meshes.append(block(face, y, z1 - 0.07, 0.006, wide, tall, CHROME))
    if build in {"sides", "french"} and rng.random() < 0.65:
        y0, y1, z0, z1, _ = doors[-1]
        wide, tall = (y1 - y0) * float(rng.uniform(0.45, 0.65)), float(rng.uniform(0.25, 0.38))
        y, z = (y0 + y1) / 2.0, max(min(1.0, z1 - tall - 0.2), z0 + 0.08)
        meshes.append(
            rounded((face - 0.01, y - wide / 2, z), (face + 0.006, y + wide / 2, z + tall), BLACK, 0.02, 0.003, 0)
        )
        meshes.append(block(face + 0.002, y, z + tall * 0.72, 0.012, wide * 0.8, tall * 0.2, GLASS))
        meshes.append(block(face + 0.01, y, z + 0.012, 0.02, wide * 0.75, 0.012, STEEL))
    elif build in {"bottom", "one"} and rng.random() < 0.35:
        wide, tall = float(rng.uniform(0.08, 0.2)), float(rng.uniform(0.03, 0.12))
        meshes.append(block(face - 0.004, (y0 + y1) / 2.0, z1 - 0.18 - tall, 0.006, wide, tall, GLASS))
        digit = Material((0.1, 0.1, 0.1), emission=(0.25, 0.4, 0.5))
        meshes.append(block(face - 0.003, (y0 + y1) / 2.0, z1 - 0.18 - tall * 0.65, 0.006, 0.03, 0.012, digit))
    if rng.random() < 0.3:
        y0, y1, z0, z1, _ = doors[int(rng.integers(len(doors)))]
        for _ in range(int(rng.integers(1, 6))):
            wide, tall = float(rng.uniform(0.04, 0.14)), float(rng.uniform(0.04, 0.14))
            if y1 - y0 < wide + 0.2 or z1 - z0 < tall + 0.2:
                continue
            y, z = float(rng.uniform(y0 + 0.09, y1 - 0.09 - wide)), float(rng.uniform(z0 + 0.08, z1 - 0.1 - tall))
            paper = Material(drawn_colour(rng, 0.9) if rng.random() < 0.5 else (0.7, 0.7, 0.66))
            meshes.append(box((face - 0.002, y, z), (face + 0.002, y + wide, z + tall), paper))
    return joined(meshes)
