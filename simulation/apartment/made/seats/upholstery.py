"""Upholstered seats for one and for many: base, cushions, arms and back in a row."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import upholstery
from edgemap.simulation.apartment.made.seats.legs import leg
from edgemap.simulation.apartment.made.seats.plans import Plan
from edgemap.simulation.apartment.made.shapes.bars import beam, rod, tube
from edgemap.simulation.apartment.made.shapes.placing import leaned, turned
from edgemap.simulation.apartment.made.shapes.solids import block, padded
from edgemap.simulation.render.mesh import Mesh


def row(rng: np.random.Generator, p: Plan, sides: tuple[bool, bool] = (True, True), chaise: int = 0) -> list[Mesh]:
    """Seats side by side with x = 0 at the seat's front edge, backs and arms (right, left).

    chaise: 1 where the left seat, -1 where the right one is as long as a bed.
    """
    thick = float(rng.uniform(0.1, 0.18))
    top, rear = p.seat - thick, -p.depth - p.back
    total = p.width
    bare = p.arms == "frame"
    base = padded(
        (rear / 2.0 + 0.03, 0.0, (p.lift + top) / 2.0), (-rear - 0.06, total, top - p.lift + 0.02), p.cover, 0.02, 0.0
    )
    meshes = _frame(p, top) if bare else [base]
    meshes += _feet(rng, p, rear, sides) if not bare else []
    parts = 1 if p.seats > 1 and rng.random() < 0.2 else p.seats
    long_ = float(rng.uniform(0.5, 0.8))
    overhang = float(rng.uniform(0.0, 0.04))
    for i, y in enumerate(_spread(total, parts)):
        far = long_ if (chaise == 1 and i == parts - 1) or (chaise == -1 and i == 0) else 0.0
        size = (p.depth + overhang + far, total / parts, thick)
        meshes.append(
            padded(((overhang - p.depth + far) / 2.0, y, p.seat - thick / 2.0), size, p.cushions, p.soft, p.swell)
        )
        if far:
            lower = (far, total / parts, top - p.lift + 0.02)
            meshes.append(padded((far / 2.0, y, (p.lift + top) / 2.0), lower, p.cover, 0.02, 0.0))
            for side in (-0.4, 0.4):
                at = np.array([far - 0.06, y + side * total / parts, p.lift + 0.01])
                meshes.append(tube(at, at * [1, 1, 0], 0.018, p.legs))
    return (
        meshes
        + _backs(rng, p, parts)
        + [mesh for side, there in zip((-1, 1), sides, strict=True) if there for mesh in _arm(p, side, rear)]
    )


def _backs(rng: np.random.Generator, p: Plan, parts: int) -> list[Mesh]:
    """A back along all seats with loose cushions before it, one padded back for each seat, or buttons in rows."""
    rear, hinge = -p.depth, (-p.depth, 0.0, p.seat)
    way = rng.random()
    meshes = []
    fixed = p.high if way > 0.6 else p.high - float(rng.uniform(0.02, 0.14))
    thin = p.back if way > 0.6 else p.back * 0.6
    low = p.seat - 0.12 if p.arms == "frame" else p.lift + 0.01
    if p.arms != "frame" or way > 0.6:
        shell = padded(
            (rear - p.back + thin / 2.0, 0.0, (low + fixed) / 2.0), (thin, p.width, fixed - low), p.cover, p.soft, 0.0
        )
        meshes.append(leaned(shell, p.lean * 0.4, (rear - p.back, 0.0, low)))
    if way > 0.85:
        for z in np.arange(p.seat + 0.12, p.high - 0.06, 0.12):
            for y in np.arange(-p.width / 2.0 + 0.12, p.width / 2.0 - 0.06, 0.2):
                at = np.array([rear + 0.008 - np.tan(p.lean * 0.4) * (z - low), y, z])
                meshes.append(beam(at, at + [0.008, 0.0, 0.0], (0.025, 0.025), p.legs, 0.6))
        return meshes
    if way > 0.6:
        return meshes
    thick, tall = float(rng.uniform(0.12, 0.22)), p.high - p.seat
    for y in _spread(p.width, parts):
        size = (thick, p.width / parts * float(rng.uniform(0.94, 1.0)), tall)
        cushion = padded(
            (rear - p.back * 0.4 + thick / 2.0, y, p.seat + tall / 2.0), size, p.cushions, p.soft * 1.3, p.swell * 1.5
        )
        meshes.append(leaned(cushion, p.lean, hinge))
    return meshes


def _arm(p: Plan, side: int, rear: float) -> list[Mesh]:
    """One arm, to the right (-1) or left (1) of all seats."""
    if p.arms == "none":
        return []
    y, length = side * (p.width + p.arm) / 2.0, -rear
    middle = rear / 2.0
    if p.arms == "frame":
        front, back = np.array([-0.04, y, 0.0]), np.array([rear + 0.1, y, 0.0])
        up = np.array([0.0, 0.0, p.rest])
        thick = p.arm * 0.7
        return [
            beam(front, front + up, (thick, thick), p.legs),
            beam(back - [0.08, 0.0, 0.0], back + up * [0, 0, p.high / p.rest * 0.94], (thick, thick), p.legs),
            beam(front + up + [0.07, 0.0, 0.0], back + up - [0.04, 0, 0], (p.arm, 0.025), p.legs),
            beam(front + [0, 0, p.seat - 0.2], back + [0, 0, p.seat - 0.22], (thick * 0.8, 0.05), p.legs),
        ]
    low = p.lift + 0.005
    if p.arms == "round":
        roll = p.arm / 2.0
        wall = padded(
            (middle, y - side * 0.02, (low + p.rest - roll) / 2.0),
            (length, p.arm * 0.75, p.rest - roll - low),
            p.cover,
            0.02,
            0.0,
        )
        path = np.array([(rear + 0.02, y, p.rest - roll), (0.01, y, p.rest - roll)])
        return [wall, rod(path, roll, p.cover, sides=16)]
    if p.arms == "pillow":
        split = p.rest - 0.16
        return [
            padded((middle, y, (low + split) / 2.0), (length, p.arm, split - low + 0.02), p.cover, 0.03, 0.0),
            padded((middle, y, p.rest - 0.09), (length * 0.98, p.arm * 1.08, 0.18), p.cushions, 0.08, 0.1),
        ]
    return [padded((middle, y, (low + p.rest) / 2.0), (length, p.arm, p.rest - low), p.cover, p.soft, 0.0)]


def _frame(p: Plan, top: float) -> list[Mesh]:
    """Rails and slats under the cushions of an open wooden frame."""
    meshes = [block(x, 0.0, top - 0.06, 0.035, p.width + p.arm, 0.06, p.legs) for x in (-0.05, -p.depth - 0.06)]
    for y in np.linspace(-0.45, 0.45, 3 * p.seats) * p.width:
        meshes.append(block(-p.depth / 2.0 - 0.05, y, top - 0.012, p.depth, 0.06, 0.012, p.legs))
        foot = np.array([-p.depth - 0.06, y, top])
        end = foot + [-np.tan(p.lean) * (p.high - top) * 0.9 - 0.03, 0.0, (p.high - top) * 0.9]
        meshes.append(beam(foot + [-0.03, 0, 0], end, (0.05, 0.015), p.legs))
    rail = np.array([-p.depth - 0.09 - np.tan(p.lean) * (p.high - top) * 0.9, 0.0, top + (p.high - top) * 0.88])
    half = np.array([0.0, (p.width + p.arm) / 2.0, 0.0])
    meshes.append(beam(rail - half, rail + half, (0.06, 0.025), p.legs, across=(0, 0, 1)))
    return meshes


def _feet(rng: np.random.Generator, p: Plan, rear: float, sides: tuple[bool, bool]) -> list[Mesh]:
    if p.lift < 0.03:
        return [block(rear / 2.0, 0.0, 0.0, -rear - 0.06, p.width - 0.04, p.lift + 0.01, p.legs)]
    way = str(rng.choice(["square", "tapered", "dowel", "turned"]))
    radius, splay = float(rng.uniform(0.015, 0.03)), float(rng.choice([0.0, 0.25]))
    right, left = (p.arm * there * 0.8 for there in sides)
    meshes = []
    for x in (-0.06, rear + 0.06):
        for y in (-p.width / 2.0 - right + 0.05, p.width / 2.0 + left - 0.05):
            top = np.array([x, y, p.lift + 0.01])
            foot = np.array([x + splay * p.lift * (1 if x > -0.1 else -1), y + splay * p.lift * np.sign(y), 0.0])
            meshes.append(leg(way, top, foot, radius, p.legs))
    return meshes


def throw_pillows(rng: np.random.Generator, p: Plan, count: int) -> list[Mesh]:
    """Loose small cushions leaning on the back."""
    meshes = []
    for _ in range(count):
        side, z = float(rng.uniform(0.34, 0.45)), p.seat + 0.02
        y = float(rng.choice([-1.0, 1.0])) * (p.width / 2.0 - side / 2.0 - float(rng.uniform(0.0, 0.15)))
        pillow = padded((0.0, 0.0, side / 2.0), (0.13, side, side), upholstery(rng), 0.05, 0.12)
        pillow = turned(
            leaned(pillow, float(rng.uniform(0.25, 0.5)), (0, 0, 0)), 2, float(rng.uniform(-0.3, 0.3)), (0, 0, 0)
        )
        meshes.append(pillow.placed(-p.depth + 0.2, y, z, 0.0))
    return meshes


def _spread(width: float, parts: int) -> list[float]:
    return [float(y) for y in (np.arange(parts) + 0.5) * width / parts - width / 2.0]
