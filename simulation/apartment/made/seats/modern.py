"""Chairs upholstered all over, moulded, of steel tube, and to fold."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import upholstery, woven
from edgemap.simulation.apartment.made.materials.plain import metal, plastic, wood
from edgemap.simulation.apartment.made.seats import backs, legs
from edgemap.simulation.apartment.made.seats.arms import arms
from edgemap.simulation.apartment.made.seats.backs import Back
from edgemap.simulation.apartment.made.seats.seat import Seat, drawn_seat
from edgemap.simulation.apartment.made.seats.shells import shell
from edgemap.simulation.apartment.made.shapes.bars import beam, rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import pad, plate, sheet
from edgemap.simulation.apartment.made.shapes.outlines import filleted, oval
from edgemap.simulation.render.mesh import Mesh


def parsons(rng: np.random.Generator) -> list[Mesh]:
    """Upholstered all over, on four short-seeming legs of wood or steel."""
    seat = drawn_seat(rng, float(rng.uniform(0.45, 0.5)), (0.42, 0.52), float(rng.uniform(0.07, 0.13)))
    cover = upholstery(rng)
    high, lean = float(rng.uniform(0.8, 1.08)), float(rng.uniform(0.05, 0.2))
    top = seat.back * float(rng.uniform(0.9, 1.05))
    back = Back(-seat.depth / 2.0 + 0.04, seat.under + 0.02, high, seat.back, top, lean, float(rng.uniform(0.0, 0.05)))
    meshes = [pad(seat.outline(float(rng.uniform(4.0, 9.0))), seat.under, seat.top, cover, 0.02)]
    meshes.append(backs.upholstered(back, float(rng.uniform(0.05, 0.09)), cover, float(rng.choice([3.0, 6.0, 14.0]))))
    way = str(rng.choice(["square", "tapered", "dowel", "sabre", "turned"]))
    foot = wood(rng) if rng.random() < 0.75 else metal(rng)
    splay, radius = float(rng.choice([0.0, rng.uniform(0.01, 0.05)])), float(rng.uniform(0.013, 0.022))
    meshes += legs.four_legs(rng, seat, way, splay, radius, foot)
    return meshes


def moulded(rng: np.random.Generator) -> list[Mesh]:
    """A shell of plastic, plywood or padding on any foot."""
    seat = drawn_seat(rng, float(rng.uniform(0.43, 0.47)), (0.42, 0.5), 0.03)
    soft = rng.random() < 0.25
    cover = (
        upholstery(rng)
        if soft
        else wood(rng)
        if rng.random() < 0.2
        else woven(rng)
        if rng.random() < 0.1
        else plastic(rng)
    )
    wings = float(rng.choice([0.0, 0.02, rng.uniform(0.05, 0.2)]))
    seat = Seat(seat.depth, seat.front + wings * 0.6, seat.back + wings * 0.6, seat.under, seat.top)
    meshes = [shell(rng, seat, float(rng.uniform(0.74, 0.88)), cover, 0.035 if soft else 0.012, wings)]
    under = Seat(seat.depth * 0.75, seat.front * 0.72, seat.back * 0.72, seat.under + 0.008, seat.top)
    foot, steel = rng.random(), metal(rng)
    if foot < 0.4:
        way = str(rng.choice(["dowel", "dowel", "tapered", "round"]))
        splay = float(rng.uniform(0.03, 0.1))
        timber = wood(rng) if rng.random() < 0.7 else steel
        meshes += legs.four_legs(rng, under, way, splay, 0.014, timber)
        a, b, c, d = under.corners(0.02)
        meshes += [beam(a, d, (0.03, 0.012), steel), beam(b, c, (0.03, 0.012), steel)]
    elif foot < 0.75:
        meshes += legs.tubular(rng, under, steel)
    elif foot < 0.9:
        meshes += legs.pedestal(rng, under.under + 0.01, steel if rng.random() < 0.5 else cover, 0.24)
    else:
        meshes += legs.star(rng, under.under + 0.01, steel, castors=False)
    return meshes


def steel(rng: np.random.Generator) -> list[Mesh]:
    """Bent tube under a padded or plain seat, with a back between two tubes."""
    seat = drawn_seat(rng, float(rng.uniform(0.43, 0.48)), (0.4, 0.48), float(rng.uniform(0.02, 0.06)))
    steel, radius = metal(rng), float(rng.uniform(0.009, 0.013))
    cover = upholstery(rng) if rng.random() < 0.6 else wood(rng) if rng.random() < 0.5 else plastic(rng)
    meshes = legs.tubular(rng, seat, steel)
    shape = seat.outline(float(rng.uniform(4.0, 8.0)))
    meshes.append(pad(shape, seat.under, seat.top, cover, float(rng.uniform(0.0, 0.02))))
    high, lean = float(rng.uniform(0.76, 0.95)), float(rng.uniform(0.1, 0.25))
    wide = seat.back - 2.0 * radius
    back = Back(-seat.depth / 2.0 + 0.03, seat.under, high, wide, wide * 0.97, lean, float(rng.uniform(0.0, 0.05)))
    low = float(rng.uniform(0.3, 0.65))
    if rng.random() < 0.5:
        path = [
            back.at(-1, 0) + [0.1, 0, -0.01],
            back.at(-1, 0),
            back.at(-1, 1),
            back.at(1, 1),
            back.at(1, 0),
            back.at(1, 0) + [0.1, 0, -0.01],
        ]
        meshes.append(rod(filleted(path, 0.06), radius, steel))
        up = np.linspace(low, 0.97, 7)
    else:
        for side in (-1, 1):
            path = [back.at(side, 0) + [0.1, 0, -0.01], back.at(side, 0), back.at(side, 0.95)]
            meshes.append(rod(filleted(path, 0.06), radius, steel))
        up = np.linspace(low, 1.0, 7)
    meshes.append(back.strip(1.0, up, float(rng.choice([0.012, 0.03])), cover))
    if rng.random() < 0.2:
        meshes += arms(rng, seat, back, radius, steel)
    return meshes


def folding(rng: np.random.Generator) -> list[Mesh]:
    """Two frames crossed at the sides: one up to the back, the other under the seat's rear."""
    wide, top = float(rng.uniform(0.38, 0.44)), float(rng.uniform(0.43, 0.47))
    body = wood(rng) if rng.random() < 0.5 else metal(rng)
    thick = 0.018 if rng.random() < 0.5 else 0.012
    depth, high = float(rng.uniform(0.38, 0.44)), float(rng.uniform(0.76, 0.88))
    foot_x = 0.24
    slope = (foot_x + depth / 2.0 + 0.06) / high
    back = Back(foot_x, 0.0, high, wide, wide, slope, 0.0)
    meshes: list[Mesh] = []
    for side in (1.0, -1.0):
        y = side * wide / 2.0
        meshes.append(beam(back.at(side, 0.0), back.at(side, 1.0), (thick, 1.8 * thick), body))
        inner = y - side * thick * 1.2
        meshes.append(beam((-0.26, inner, 0.0), (depth / 2.0 - 0.03, inner, top - 0.02), (thick, 1.8 * thick), body))
    for x, z, y in ((-0.22, 0.07, wide / 2 - 0.02), (foot_x - slope * 0.1, 0.1, wide / 2)):
        meshes.append(tube((x, y, z), (x, -y, z), 0.008, body))
    seat_mid = 0.02
    if rng.random() < 0.5:
        count = int(rng.integers(4, 8))
        for x in np.linspace(-depth / 2.0, depth / 2.0, count) * 0.9 + seat_mid:
            meshes.append(
                beam(
                    (x, wide / 2, top - 0.008),
                    (x, -wide / 2, top - 0.008),
                    (depth / count * 0.75, 0.015),
                    body,
                    across=(1, 0, 0),
                )
            )
        bars = int(rng.integers(1, 4))
        for at in np.linspace(0.97 - 0.075 * bars, 0.97, bars + 1)[1:]:
            meshes.append(back.strip(1.0, [at - 0.06, at], 0.012, body))
    else:
        cover = plastic(rng) if rng.random() < 0.5 else upholstery(rng)
        meshes.append(pad(oval(depth, wide, 7.0), top - 0.03, top, cover, 0.008).placed(seat_mid, 0.0, 0.0, 0.0))
        meshes.append(back.strip(1.0, np.linspace(float(rng.uniform(0.72, 0.85)), 0.99, 4), 0.02, cover))
    return meshes


def garden(rng: np.random.Generator) -> list[Mesh]:
    """One moulding of plastic: slatted back, arms and broad legs."""
    seat = drawn_seat(rng, float(rng.uniform(0.4, 0.45)), (0.44, 0.5), 0.03)
    body = plastic(rng)
    back = Back(
        -seat.depth / 2.0 + 0.02, seat.under, float(rng.uniform(0.76, 0.95)), seat.back, seat.back * 0.95, 0.22, 0.06
    )
    meshes = [plate(seat.outline(7.0), seat.under, seat.top, body)]
    tops = seat.corners(0.03)
    for top in tops:
        foot = top + [np.sign(top[0]) * 0.04, np.sign(top[1]) * 0.05, -top[2]]
        meshes.append(beam(top + [0, np.sign(top[1]) * 0.01, 0.0], foot, (0.055, 0.045), body, 0.75))
    meshes += backs.hoop(rng, back, body, 0.02, str(rng.choice(["board", "spindles"])))
    if rng.random() < 0.4:
        for at in np.linspace(-0.6, 0.6, 5):
            edges = at + np.array([-0.09, 0.09])
            meshes.append(sheet(back.at(edges, np.array([[0.0], [0.8]])), 0.012, body))
    if rng.random() < 0.75:
        meshes += arms(rng, seat, back, 0.024, body)
    return meshes
