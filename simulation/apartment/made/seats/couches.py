"""Couches for two to four, with a chaise or round a corner, and armchairs of the same builds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import leather, upholstery, woven
from edgemap.simulation.apartment.made.materials.plain import metal, wood
from edgemap.simulation.apartment.made.seats import legs
from edgemap.simulation.apartment.made.seats.plans import plan
from edgemap.simulation.apartment.made.seats.seat import Seat
from edgemap.simulation.apartment.made.seats.shells import shell
from edgemap.simulation.apartment.made.seats.upholstery import row, throw_pillows
from edgemap.simulation.apartment.made.shapes.bars import rod
from edgemap.simulation.apartment.made.shapes.lofts import pad, sheet
from edgemap.simulation.apartment.made.shapes.outlines import oval
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import padded
from edgemap.simulation.render.mesh import Array, Material, Mesh


def couch(rng: np.random.Generator) -> Mesh:
    """Two to four seats in a row, now and then with a chaise at one end or rolled arms as high as the back."""
    way = rng.random()
    seats = int(rng.choice([2, 2, 3, 3, 3, 4]))
    p = plan(rng, seats)
    if way < 0.12:
        p = replace(plan(rng, seats, "round"), cover=leather(rng))
        p = replace(p, rest=p.high, cushions=p.cover, lift=max(p.lift, 0.06))
    chaise = int(rng.choice([-1, 1])) if 0.12 < way < 0.28 and p.arms != "frame" else 0
    meshes = row(rng, p, chaise=chaise)
    if rng.random() < 0.45:
        meshes += throw_pillows(rng, p, int(rng.integers(1, 4)))
    return joined(meshes)


def corner_couch(rng: np.random.Generator) -> Mesh:
    """Two rows of seats at a right angle, with backs along both walls."""
    side = int(rng.choice([-1, 1]))
    p = plan(rng, int(rng.choice([2, 3])), str(rng.choice(["box", "slim", "pillow", "round"])))
    deep = p.depth + p.back
    other = replace(p, seats=int(rng.choice([1, 2])))
    other = replace(other, width=p.width / p.seats * other.seats)
    first = joined(row(rng, p, (side < 0, side > 0)))
    # The second row begins in front of the corner, which is a seat of its own with backs on both walls.
    second = joined(row(rng, other, (side > 0, side < 0)))
    turn = side * np.pi / 2.0
    seat = p.seat - 0.14
    y = -side * (p.width + deep) / 2.0
    corner = [
        padded((-deep / 2.0, y, (p.lift + seat) / 2.0), (deep, deep, seat - p.lift + 0.02), p.cover, 0.02, 0.0),
        padded(
            (-p.depth / 2.0, y + side * p.back / 2.0, p.seat - 0.07),
            (p.depth, p.depth, 0.14),
            p.cushions,
            p.soft,
            p.swell,
        ),
        padded(
            (p.back / 2.0 - deep, y, (p.lift + p.high) / 2.0),
            (p.back, deep, p.high - p.lift - 0.02),
            p.cover,
            p.soft,
            0.0,
        ),
        padded(
            (-deep / 2.0, y + side * (p.back - deep) / 2.0, (p.lift + p.high) / 2.0),
            (deep, p.back, p.high - p.lift - 0.02),
            p.cover,
            p.soft,
            0.0,
        ),
    ]
    placed = second.placed(other.width / 2.0, y + side * deep / 2.0, 0.0, turn)
    return joined([first, placed, *corner])


def armchair(rng: np.random.Generator) -> Mesh:
    """An easy chair: a couch for one, a wing chair, a tub, a bucket on a foot, or basketwork."""
    way = rng.random()
    if way < 0.5:
        arms = str(rng.choice(["box", "round", "slim", "pillow", "frame", "frame"]))
        p = plan(rng, 1, arms)
        return joined(row(rng, p) + (throw_pillows(rng, p, 1) if rng.random() < 0.15 else []))
    if way < 0.75:
        return joined(_tub(rng))
    wide = float(rng.uniform(0.58, 0.72))
    seat = Seat(float(rng.uniform(0.52, 0.62)), wide, wide, float(rng.uniform(0.3, 0.38)), 0.42)
    basket = rng.random() < 0.3
    cover = woven(rng) if basket else upholstery(rng)
    high, wings = float(rng.uniform(0.78, 1.05)), float(rng.uniform(0.14, 0.24))
    meshes = [shell(rng, seat, high, cover, 0.02 if basket else float(rng.uniform(0.05, 0.09)), wings)]
    under = Seat(seat.depth * 0.75, wide * 0.65, wide * 0.65, seat.under + 0.015, 0.42)
    way = rng.random()
    if way < 0.45:
        meshes += legs.four_legs(rng, under, "dowel", float(rng.uniform(0.04, 0.1)), 0.018, wood(rng))
    elif way < 0.65:
        meshes += legs.tubular(rng, under, metal(rng))
    elif way < 0.8:
        meshes += legs.pedestal(rng, under.under + 0.01, metal(rng), 0.27)
    else:
        meshes += legs.star(rng, under.under + 0.01, metal(rng), castors=False)
    if rng.random() < 0.5:
        size = oval(seat.depth * 0.8, wide * 0.72, 4.0, width_behind=wide * 0.66)
        meshes.append(pad(size, seat.under + 0.04, seat.under + 0.12, upholstery(rng), 0.02))
    return joined(meshes)


def _tub(rng: np.random.Generator) -> list[Mesh]:
    """Arms and back in one bow round a seat: low as in a tub, high at the back as in a wing chair."""
    wide, deep = float(rng.uniform(0.62, 0.8)), float(rng.uniform(0.6, 0.76))
    seat, rest = float(rng.uniform(0.38, 0.46)), float(rng.uniform(0.58, 0.68))
    high = float(rng.choice([rest + 0.06, rng.uniform(0.74, 0.86), rng.uniform(0.9, 1.1)]))
    lift, thick = float(rng.choice([0.02, rng.uniform(0.08, 0.18)])), float(rng.uniform(0.06, 0.12))
    basket = rng.random() < 0.25
    cover, square = (woven(rng) if basket else upholstery(rng)), float(rng.uniform(2.5, 6.0))
    turn = np.linspace(-0.9, 0.9, 25) * np.pi / 1.8
    # The bow opens to the front; its columns run from the left arm round the back to the right one.
    x = -np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** (2.0 / square) * (deep - 0.1)
    y = -np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** (2.0 / square) * wide / 2.0
    rise = np.clip((np.cos(turn) - 0.15) * float(rng.uniform(1.3, 3.0)), 0.0, 1.0)
    top = rest + (high - rest) * rise * rise * (3.0 - 2.0 * rise)
    up = np.linspace(0.0, 1.0, 9)[:, None]
    z = lift + up * (top - lift)
    out = 1.0 + float(rng.uniform(0.0, 0.12)) * up
    bow = np.stack([x * out + 0.1, y * out, z], axis=2)[:, ::-1]
    body = np.sqrt(1.0 - (2.0 * up - 1.0) ** 6 * 0.6) * np.sqrt(1.0 - np.linspace(-1, 1, 25) ** 8 * 0.6)
    meshes = [sheet(bow, 0.025 if basket else thick * body, cover)]
    shape = oval(deep - 0.02, wide - thick * 0.6, max(3.0, square), width_behind=(wide - thick) * 0.92)
    shape = shape + [0.1 - deep / 2.0 + 0.06, 0.0]
    meshes.append(
        _apart(shape, lift, seat - 0.12, seat, cover, upholstery(rng) if basket or rng.random() < 0.3 else cover, rng)
    )
    under = Seat(deep * 0.9, wide * 0.85, wide * 0.75, lift + 0.02, seat)
    if lift > 0.03:
        radius = float(rng.uniform(0.014, 0.022))
        tops = under.corners(0.06) + [0.1 - deep / 2.0 + 0.04, 0.0, 0.0]
        meshes += [legs.leg("dowel", at, at * [1.0, 1.05, 0.0], radius, wood(rng)) for at in tops]
    if basket:
        rim = bow[-1]
        meshes.append(rod(rim, 0.016, cover))
    return meshes


def _apart(
    shape: Array, low: float, middle: float, top: float, cover: Material, cushion: Material, rng: np.random.Generator
) -> Mesh:
    """A base and a cushion on it, of an outline (N, 2) that need not lie about the origin."""
    centre = shape.mean(axis=0)
    moved = shape - centre
    both = [
        pad(moved * 0.98, low, middle + 0.01, cover, 0.0),
        pad(moved, middle, top, cushion, float(rng.uniform(0.01, 0.04))),
    ]
    return joined([mesh.placed(float(centre[0]), float(centre[1]), 0.0, 0.0) for mesh in both])
