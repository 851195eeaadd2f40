"""Refrigerators, cookers and microwave ovens."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edgemap.simulation.apartment.made.lofts import arc, loft, oval, pipe, rounded
from edgemap.simulation.apartment.made.shapes import BLACK, STEEL, block, drawn_colour, joined, lathe, tube, wood
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Material, Mesh, box

# A door at a depth between y0 and y1, z0 and z1; a knob on a face at y and z with a radius.
Door = Callable[[float, float, float, float, float], Mesh]
Knob = Callable[[float, float, float, float], Mesh]
_RUBBER = Material((0.03, 0.03, 0.032))
_CHROME = Material((0.6, 0.6, 0.62), gloss=0.6)
_GLASS = Material((0.012, 0.012, 0.014), gloss=0.6)


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
    front = _finish(rng, 0.75 if build == "retro" else 0.12)
    steel = front.texture is not None
    sides = Material((0.12, 0.12, 0.125), gloss=0.15) if steel and rng.random() < 0.6 else front
    if steel and sides is front:
        sides = Material((0.3, 0.3, 0.31), gloss=0.2)
    radius = float(rng.uniform(0.05, 0.1)) if build == "retro" else float(rng.uniform(0.003, 0.02))
    foot = float(rng.uniform(0.03, 0.1))
    half, gap = width / 2.0, float(rng.uniform(0.006, 0.014))
    rubber = Material((0.2, 0.2, 0.2)) if max(front.colour) < 0.08 else _RUBBER
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


_FRIDGES = (0.12, 0.13, 0.2, 0.24, 0.11, 0.08, 0.12)
_Door = tuple[float, float, float, float, int]


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
    material = (_CHROME, STEEL, BLACK, front)[int(rng.choice(4, p=[0.3, 0.3, 0.15, 0.25]))]
    dark = max(front.colour) < 0.08
    if dark and rng.random() < 0.8:
        # A black door without a bright handle tells nobody what it is.
        way, material = str(rng.choice(["bar", "bow", "flat"])), _CHROME
    if way == "lever":
        material = _CHROME
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
            return pipe(bow, thick, np.cross(out, line), material, wide=thick * 1.4)
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
            return box(low, high, _RUBBER)
        if way == "groove":
            # No handle but a dark groove along the whole edge.
            if side == 2:
                return box((face - 0.02, y0 + 0.004, z1 - 0.022), (face + 0.001, y1 - 0.004, z1 - 0.004), _RUBBER)
            edge = y1 - 0.016 if side > 0 else y0 + 0.003
            return box((face - 0.02, edge, z0 + 0.02), (face + 0.001, edge + 0.013, z1 - 0.02), _RUBBER)
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
        meshes.append(block(face, y, z1 - 0.07, 0.006, wide, tall, _CHROME))
    if build in {"sides", "french"} and rng.random() < 0.65:
        y0, y1, z0, z1, _ = doors[-1]
        wide, tall = (y1 - y0) * float(rng.uniform(0.45, 0.65)), float(rng.uniform(0.25, 0.38))
        y, z = (y0 + y1) / 2.0, max(min(1.0, z1 - tall - 0.2), z0 + 0.08)
        meshes.append(
            rounded((face - 0.01, y - wide / 2, z), (face + 0.006, y + wide / 2, z + tall), BLACK, 0.02, 0.003, 0)
        )
        meshes.append(block(face + 0.002, y, z + tall * 0.72, 0.012, wide * 0.8, tall * 0.2, _GLASS))
        meshes.append(block(face + 0.01, y, z + 0.012, 0.02, wide * 0.75, 0.012, STEEL))
    elif build in {"bottom", "one"} and rng.random() < 0.35:
        wide, tall = float(rng.uniform(0.08, 0.2)), float(rng.uniform(0.03, 0.12))
        meshes.append(block(face - 0.004, (y0 + y1) / 2.0, z1 - 0.18 - tall, 0.006, wide, tall, _GLASS))
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


def _finish(rng: np.random.Generator, coloured: float) -> Material:
    """Enamel white, cream, grey or black, brushed steel, or with the given chance any colour."""
    if rng.random() < coloured:
        return Material(drawn_colour(rng, 0.9), gloss=float(rng.uniform(0.2, 0.5)))
    way = rng.random()
    if way < 0.42:
        value, gloss = float(rng.uniform(0.6, 0.8)), float(rng.uniform(0.1, 0.4))
        return Material((value, value, value * float(rng.uniform(0.9, 1.0))), gloss=gloss)
    if way < 0.75:
        value = float(rng.uniform(0.22, 0.55))
        brushed = 1.0 + 0.025 * noise(rng, 128, 128, stretch=24.0, slope=0.5)
        texels = np.full((128, 128, 4), 255, dtype=np.uint8)
        texels[..., :3] = np.clip(brushed[..., None] * 228.0, 0.0, 255.0).astype(np.uint8)
        return Material((value, value, value * 1.02), texels, gloss=float(rng.uniform(0.4, 0.65)))
    value = float(rng.choice([0.02, 0.04, 0.12, 0.3]))
    return Material((value, value, value), gloss=float(rng.uniform(0.2, 0.5)))


def oven(rng: np.random.Generator) -> Mesh:
    """A cooker with a hob, knobs and one or more dark-windowed doors, or ovens built into a housing."""
    build = str(rng.choice(["cooker", "range", "under", "tower"], p=[0.5, 0.16, 0.17, 0.17]))
    front = _finish(rng, 0.2 if build == "range" else 0.06)
    width = float(rng.uniform(0.88, 1.1)) if build == "range" else float(rng.uniform(0.5, 0.76))
    depth = float(rng.uniform(0.54, 0.64))
    height = float(rng.uniform(1.0, 1.5)) if build == "tower" else float(rng.uniform(0.84, 0.93))
    half, foot = width / 2.0, float(rng.uniform(0.04, 0.11))
    body = front
    if build in {"under", "tower"}:
        body = wood(rng) if rng.random() < 0.6 else Material((0.68, 0.68, 0.67), gloss=0.2)
    elif front.texture is not None or rng.random() < 0.2:
        body = (
            Material((0.1, 0.1, 0.105), gloss=0.15) if rng.random() < 0.5 else Material((0.35, 0.35, 0.36), gloss=0.3)
        )
    meshes = [
        box((0.0, -half, foot), (depth, half, height - 0.03), body),
        box((0.03, -half + 0.02, 0.0), (depth - 0.04, half - 0.02, foot + 0.001), BLACK),
    ]
    door = _oven_door_maker(rng, front)
    knob = _knob_maker(rng)
    top = height - 0.03
    if build == "tower":
        meshes.append(box((0.0, -half, height - 0.031), (depth, half, height), body))
        return joined(meshes + _tower(rng, door, knob, front, (depth, half, foot, height)))
    back_panel = float(rng.uniform(0.08, 0.24)) if build == "cooker" and rng.random() < 0.55 else 0.0
    panel_knobs = back_panel > 0.12 and rng.random() < 0.5
    slab = body if build == "under" else (front if rng.random() < 0.6 else BLACK)
    if build == "under":
        slab = wood(rng) if rng.random() < 0.5 else Material(drawn_colour(rng, 0.15), gloss=0.3)
    meshes.append(rounded((0.0, -half, top - 0.001), (depth + 0.02, half, height), slab, 0.008, 0.004))
    meshes += _hob(rng, depth, half * (0.9 if build == "under" else 1.0), height)
    if back_panel:
        meshes.append(
            rounded((0.0, -half, height - 0.01), (0.05, half, height + back_panel), front, 0.01, 0.006, axis=0)
        )
        clock = block(0.05, 0.0, height + back_panel * 0.4, 0.006, width * 0.28, back_panel * 0.4, _GLASS)
        meshes += [clock] if back_panel > 0.1 else []
    band = float(rng.uniform(0.02, 0.04)) if panel_knobs else float(rng.uniform(0.09, 0.13))
    strip = front if rng.random() < 0.7 else BLACK
    meshes.append(
        rounded(
            (depth - 0.01, -half + 0.002, top - band),
            (depth + 0.028, half - 0.002, top - 0.002),
            strip,
            0.006,
            0.003,
            axis=0,
        )
    )
    count = int(rng.integers(5, 9)) if build == "range" else int(rng.integers(4, 7))
    if panel_knobs:
        spots = np.concatenate([np.linspace(-0.42, -0.24, count // 2), np.linspace(0.24, 0.42, count - count // 2)])
        meshes += [knob(0.05, y * width, height + back_panel * 0.58, min(0.022, back_panel * 0.17)) for y in spots]
    else:
        meshes += _front_knobs(rng, knob, count, width, depth + 0.028, top - band / 2.0, band)
    meshes += _fronts(rng, door, front, build, (depth, half, foot + 0.004, top - band - 0.005))
    return joined(meshes)


def _front_knobs(
    rng: np.random.Generator, knob: Knob, count: int, width: float, face: float, z: float, band: float
) -> list[Mesh]:
    """A row of knobs along the band over the door, with or without a clock between them."""
    size = float(rng.uniform(0.2, 0.25)) * min(band, 0.11)
    if rng.random() < 0.5:
        return [knob(face, y * width, z, size) for y in np.linspace(-0.4, 0.4, count)]
    left = count // 2
    spots = np.concatenate([np.linspace(-0.42, -0.17, left), np.linspace(0.17, 0.42, count - left)])
    clock = block(face, 0.0, z - band * 0.25, 0.004, width * 0.2, band * 0.5, _GLASS)
    digit = Material((0.1, 0.1, 0.1), emission=(0.1, 0.5, 0.35) if rng.random() < 0.5 else (0.6, 0.1, 0.05))
    shown = block(face + 0.001, 0.0, z - band * 0.1, 0.005, 0.045, band * 0.2, digit)
    return [clock, shown, *(knob(face, y * width, z, size) for y in spots)]


def _fronts(
    rng: np.random.Generator, door: Door, front: Material, build: str, sides: tuple[float, float, float, float]
) -> list[Mesh]:
    """Doors below the band: one and a drawer, one, two above each other, or two and a grill side by side."""
    depth, half, low, high = sides
    side = half - 0.003
    if build == "range":
        cut, tall = float(rng.uniform(-0.1, 0.1)) * half, float(rng.uniform(0.0, 0.3))
        ledge = low + (high - low) * (0.16 if rng.random() < 0.5 else 0.0)
        meshes = [
            door(depth, cut + 0.003, side, ledge + 0.003, high),
            door(depth, -side, cut - 0.003, ledge + 0.003, high),
        ]
        if tall > 0.15:
            middle = ledge + (high - ledge) * 0.62
            meshes = meshes[1:] + [
                door(depth, cut + 0.003, side, ledge + 0.003, middle - 0.003),
                door(depth, cut + 0.003, side, middle + 0.003, high),
            ]
        if ledge > low:
            meshes.append(
                rounded((depth, -side, low), (depth + 0.028, side, ledge - 0.003), front, 0.005, 0.004, axis=0)
            )
        return meshes
    way = rng.random()
    if way < 0.6:
        cut = low + (high - low) * float(rng.uniform(0.18, 0.28))
        drawer = rounded((depth, -side, low), (depth + 0.03, side, cut - 0.003), front, 0.006, 0.004, axis=0)
        slot = box((depth + 0.02, -side * 0.5, cut - 0.025), (depth + 0.031, side * 0.5, cut - 0.012), _RUBBER)
        return [drawer, door(depth, -side, side, cut + 0.003, high), *([slot] if rng.random() < 0.5 else [])]
    if way < 0.85:
        return [door(depth, -side, side, low, high)]
    cut = low + (high - low) * float(rng.uniform(0.55, 0.65))
    return [door(depth, -side, side, low, cut - 0.003), door(depth, -side, side, cut + 0.003, high)]


def _tower(
    rng: np.random.Generator, door: Door, knob: Knob, front: Material, sides: tuple[float, float, float, float]
) -> list[Mesh]:
    """Two ovens above each other in a housing, each with a band of knobs or keys, or one band for both."""
    depth, half, low, high = sides
    side, cut = half - float(rng.uniform(0.004, 0.03)), low + (high - low) * float(rng.uniform(0.5, 0.58))
    band, both = float(rng.uniform(0.07, 0.11)), rng.random() < 0.5
    low += float(rng.uniform(0.005, 0.1))
    meshes = []
    for z0, z1, banded in ((low, cut, both), (cut + 0.006, high - 0.01, True)):
        top = z1 - band - 0.004 if banded else z1
        meshes.append(door(depth, -side, side, z0, top))
        if banded:
            strip = front if rng.random() < 0.5 else BLACK
            meshes.append(
                rounded((depth - 0.01, -side, z1 - band), (depth + 0.028, side, z1), strip, 0.005, 0.003, axis=0)
            )
            meshes += _front_knobs(rng, knob, int(rng.integers(2, 5)), 2 * side, depth + 0.028, z1 - band / 2.0, band)
    return meshes


def _oven_door_maker(rng: np.random.Generator, front: Material) -> Door:
    """One way of oven doors for one cooker: framed or all glass, with a bar along the top."""
    framed, away = rng.random() < 0.55, float(rng.uniform(0.035, 0.055))
    bar, thick = (
        (_CHROME, STEEL, BLACK, front)[int(rng.choice(4, p=[0.35, 0.35, 0.15, 0.15]))],
        float(rng.uniform(0.008, 0.013)),
    )
    bowed, round_ = rng.random() < 0.25, float(rng.uniform(0.004, 0.05))
    racks, cloth = rng.random() < 0.5, rng.random() < 0.15
    towel = Material(drawn_colour(rng, 0.9))
    share, tall = float(rng.uniform(0.6, 0.82)), float(rng.uniform(0.45, 0.62))

    def door(depth: float, y0: float, y1: float, z0: float, z1: float) -> Mesh:
        face, wide, high = depth + 0.03, y1 - y0, z1 - z0
        meshes = [rounded((depth, y0, z0), (face, y1, z1), front if framed else _GLASS, 0.008, 0.005, axis=0)]
        y, z = (y0 + y1) / 2.0, z0 + high * 0.44
        a, b = wide * share / 2.0, high * tall / 2.0
        if framed:
            meshes.append(
                rounded((face - 0.006, y - a, z - b), (face + 0.003, y + a, z + b), _GLASS, round_, 0.002, axis=0)
            )
        elif rng.random() < 0.5:
            trim = rounded((face - 0.005, y0, z1 - high * 0.2), (face + 0.002, y1, z1), front, 0.004, 0.001, axis=0)
            meshes.append(trim)
        if racks:
            inner = Material((0.05, 0.05, 0.05), gloss=0.4)
            for share_z in (-0.35, 0.25):
                meshes.append(block(face + 0.0005, y, z + b * share_z, 0.007, 1.7 * a, 0.006, inner))
        z_bar, c = z1 - max(0.045, high * 0.1), wide * 0.42
        if bowed:
            bow = arc((face - 0.004, y - c, z_bar), (face - 0.004, y + c, z_bar), (away, 0.0, 0.0), 13)
            meshes.append(pipe(bow, thick, (0.0, 0.0, 1.0), bar))
        else:
            meshes.append(tube((face + away, y - c, z_bar), (face + away, y + c, z_bar), thick, bar))
            for end in (y - c + 0.03, y + c - 0.03):
                meshes.append(tube((face - 0.002, end, z_bar), (face + away, end, z_bar), thick * 0.8, bar))
            if cloth and wide > 0.4:
                x, long = face + away, high * 0.5
                for at_x in (x - thick - 0.005, x + thick + 0.001):
                    meshes.append(block(at_x + 0.002, y + c * 0.3, z_bar - long, 0.005, 0.2, long, towel))
                meshes.append(block(x, y + c * 0.3, z_bar + thick - 0.003, 2 * thick + 0.01, 0.2, 0.008, towel))
        return joined(meshes)

    return door


def _knob_maker(rng: np.random.Generator) -> Knob:
    """One way of knobs: plain, with a collar, with a grip across."""
    material = (BLACK, STEEL, _CHROME, Material((0.7, 0.7, 0.69), gloss=0.3))[int(rng.integers(4))]
    collar, grip = rng.random() < 0.4, rng.random() < 0.5
    long = float(rng.uniform(0.016, 0.032))

    def knob(face: float, y: float, z: float, radius: float) -> Mesh:
        meshes = [tube((face - 0.002, y, z), (face + long, y, z), radius, material, radius * 0.85)]
        if collar:
            meshes.append(tube((face - 0.002, y, z), (face + 0.005, y, z), radius * 1.3, STEEL))
        if grip:
            mark = Material((0.7, 0.7, 0.7)) if max(material.colour) < 0.1 else BLACK
            meshes.append(block(face + long, y, z, 0.004, radius * 0.3, radius * 0.9, mark))
        return joined(meshes)

    return knob


def _hob(rng: np.random.Generator, depth: float, half: float, height: float) -> list[Mesh]:
    """Gas burners under grates, ceramic glass with rings, coils or solid plates."""
    columns = 3 if half > 0.42 else 2
    ys = np.linspace(-half * 0.52, half * 0.52, columns) if columns == 2 else np.linspace(-half * 0.64, half * 0.64, 3)
    spots = [(depth * x, float(y)) for x in (0.34, 0.74) for y in ys]
    radii = [float(r) for r in rng.uniform(0.065, 0.1, len(spots))]
    way = str(rng.choice(["gas", "glass", "coil", "plate"], p=[0.4, 0.3, 0.15, 0.15]))
    meshes: list[Mesh] = []
    if way == "glass":
        meshes.append(block(depth * 0.53, 0.0, height - 0.001, depth * 0.86, half * 1.86, 0.006, _GLASS))
        mark = Material((0.25, 0.25, 0.26))
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(_rings(x, y, height + 0.0055, (r, r * 0.62), 0.003, mark))
        return meshes
    if way == "plate":
        iron = Material((0.04, 0.04, 0.042), gloss=0.1)
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(
                Mesh(
                    (
                        lathe(np.array([r + 0.006, r + 0.006, r]), np.array([0.0, 0.006, 0.007]) + height, STEEL).moved(
                            np.eye(3), np.array([x, y, 0.0])
                        ),
                    )
                )
            )
            meshes.append(
                loft(
                    [np.c_[oval(2 * r, 2 * r, points=20) + [x, y], np.full(21, height + z)] for z in (0.0, 0.016)], iron
                )
            )
        return meshes
    if way == "coil":
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(_rings(x, y, height + 0.0005, (r + 0.008,), r + 0.004, STEEL))
            meshes.append(_rings(x, y, height + 0.012, (r, r * 0.76, r * 0.52, r * 0.28), 0.011, BLACK))
        return meshes
    tray = BLACK if rng.random() < 0.5 else STEEL
    meshes.append(block(depth * 0.53, 0.0, height - 0.001, depth * 0.84, half * 1.84, 0.003, tray))
    iron, up = Material((0.012, 0.012, 0.012)), float(rng.uniform(0.02, 0.035))
    for (x, y), r in zip(spots, radii, strict=True):
        meshes.append(tube((x, y, height), (x, y, height + 0.012), r * 0.5, STEEL))
        meshes.append(tube((x, y, height + 0.012), (x, y, height + 0.018), r * 0.42, BLACK))
        for turn in (0.0, np.pi / 2):
            long = 0.13 if turn else 0.115
            a, b = (0.01, 2 * min(long, half * 0.8 / columns)) if turn else (2 * min(long, depth * 0.19), 0.01)
            meshes.append(block(x, y, height + up, a, b, 0.01, iron))
            for sign in (-1, 1):
                meshes.append(
                    block(
                        x + sign * (a / 2 - 0.005) * (not turn),
                        y + sign * (b / 2 - 0.005) * bool(turn),
                        height,
                        0.01,
                        0.01,
                        up + 0.001,
                        iron,
                    )
                )
    if rng.random() < 0.6:
        for y in ys:
            for dx in (-0.42, 0.42):
                meshes.append(
                    block(
                        depth * 0.54 + dx * depth * 0.88, float(y), height + up, 0.01, half * 1.7 / columns, 0.01, iron
                    )
                )
            for dy in (-0.85, 0.85):
                meshes.append(
                    block(depth * 0.54, float(y) + dy * half / columns, height + up, depth * 0.75, 0.01, 0.01, iron)
                )
    return meshes


def _rings(x: float, y: float, z: float, radii: tuple[float, ...], width: float, material: Material) -> Mesh:
    """Flat rings with their outer radii and one width, on the level."""
    parts = []
    for radius in radii:
        inner = max(radius - width, 0.001)
        rise = np.array([z, z + 1e-4])
        flat = lathe(np.array([radius, inner]), rise, material, sides=24)
        parts.append(flat.moved(np.eye(3), np.array([x, y, 0.0])))
    return Mesh(tuple(parts))


def microwave(rng: np.random.Generator) -> Mesh:
    """A low box on feet: a dark window in a door on the left, keys or dials and a display to its right."""
    width, height = float(rng.uniform(0.42, 0.56)), float(rng.uniform(0.24, 0.33))
    depth, foot = float(rng.uniform(0.3, 0.42)), float(rng.uniform(0.008, 0.018))
    case = _finish(rng, 0.2)
    front = case if rng.random() < 0.6 else (_finish(rng, 0.1) if rng.random() < 0.5 else BLACK)
    half, radius = width / 2.0, float(rng.uniform(0.004, 0.03))
    meshes = [rounded((0.0, -half, foot), (depth, half, foot + height), case, radius, 0.004, axis=0)]
    for x in (0.04, depth - 0.04):
        for y in (-half + 0.04, half - 0.04):
            meshes.append(block(x, y, 0.0, 0.03, 0.03, foot + 0.005, BLACK))
    face, low, high = depth + 0.022, foot + 0.003, foot + height - 0.003
    cut = half - width * float(rng.uniform(0.68, 0.78))
    panel = front if rng.random() < 0.5 else BLACK
    meshes.append(rounded((depth - 0.002, cut + 0.002, low), (face, half - 0.002, high), front, radius, 0.004, axis=0))
    meshes.append(
        rounded((depth - 0.002, -half + 0.002, low), (face, cut - 0.002, high), panel, radius * 0.5, 0.004, axis=0)
    )
    rim = float(rng.uniform(0.025, 0.055))
    window = ((face - 0.004, cut + rim + 0.02, low + rim), (face + 0.002, half - rim, high - rim))
    meshes.append(rounded(*window, _GLASS, float(rng.uniform(0.003, 0.03)), 0.001, axis=0))
    if rng.random() < 0.5:
        inner = np.array(window) + [[0.0, 0.03, 0.025], [0.0005, -0.03, -0.025]]
        meshes.append(box(inner[0], inner[1], Material((0.05, 0.05, 0.048), gloss=0.4)))
    meshes.append(_microwave_handle(rng, face, cut, low, high))
    meshes += _panel(rng, face, (-half, cut), (low, high), max(panel.colour) < 0.2)
    for z in np.linspace(foot + height * 0.5, foot + height * 0.75, 5) if rng.random() < 0.7 else []:
        for y in (-half - 0.0005, half - 0.0005):
            meshes.append(box((depth * 0.2, y, z), (depth * 0.6, y + 0.001, z + 0.006), _RUBBER))
    return joined(meshes)


def _microwave_handle(rng: np.random.Generator, face: float, cut: float, low: float, high: float) -> Mesh:
    way, y = rng.random(), cut + 0.022
    bar = (_CHROME, STEEL, BLACK)[int(rng.integers(3))]
    if way < 0.45:
        ends = np.array([[face + 0.03, y, low + 0.03], [face + 0.03, y, high - 0.03]])
        posts = [tube((face - 0.002, y, z), (face + 0.03, y, z), 0.006, bar) for z in (low + 0.045, high - 0.045)]
        return joined([tube(ends[0], ends[1], 0.008, bar), *posts])
    if way < 0.65:
        return pipe(
            arc((face - 0.003, y, low + 0.03), (face - 0.003, y, high - 0.03), (0.035, 0, 0)), 0.007, (0, 1, 0), bar
        )
    return box((face - 0.01, cut + 0.004, low + 0.01), (face + 0.001, cut + 0.014, high - 0.01), _RUBBER)


def _panel(
    rng: np.random.Generator, face: float, ys: tuple[float, float], zs: tuple[float, float], dark: bool
) -> list[Mesh]:
    """Display and keys, or two dials, between y and z limits."""
    y, wide, tall = (ys[0] + ys[1]) / 2.0, ys[1] - ys[0], zs[1] - zs[0]
    key = Material((0.4, 0.4, 0.4)) if dark else Material((0.12, 0.12, 0.13))
    if rng.random() < 0.3:
        ring = STEEL if dark else Material((0.2, 0.2, 0.2), gloss=0.3)
        radius = min(wide * 0.3, 0.032)
        return [
            tube((face - 0.002, y, zs[0] + tall * s), (face + 0.022, y, zs[0] + tall * s), radius, ring)
            for s in (0.3, 0.7)
        ]
    digit = Material((0.05, 0.05, 0.05), emission=(0.1, 0.5, 0.3) if rng.random() < 0.6 else (0.2, 0.4, 0.6))
    meshes = [
        block(face - 0.002, y, zs[1] - tall * 0.22, 0.006, wide * 0.7, tall * 0.13, _GLASS),
        block(face - 0.001, y, zs[1] - tall * 0.18, 0.006, wide * 0.4, tall * 0.055, digit),
    ]
    rows = int(rng.integers(3, 6))
    for z in np.linspace(zs[0] + tall * 0.12, zs[0] + tall * 0.62, rows):
        for dy in (-0.25, 0.0, 0.25):
            meshes.append(block(face - 0.001, y + dy * wide, z, 0.005, wide * 0.17, tall * 0.05, key))
    return meshes
