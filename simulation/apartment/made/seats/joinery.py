"""Chairs of wood: joiners', Windsor and bentwood ones."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import upholstery, woven
from edgemap.simulation.apartment.made.materials.plain import wood
from edgemap.simulation.apartment.made.seats import backs, legs
from edgemap.simulation.apartment.made.seats.arms import arms
from edgemap.simulation.apartment.made.seats.backs import Back
from edgemap.simulation.apartment.made.seats.seat import Seat, cushioned, drawn_seat
from edgemap.simulation.apartment.made.shapes.bars import bar, beam, rod
from edgemap.simulation.apartment.made.shapes.lofts import plate
from edgemap.simulation.apartment.made.shapes.outlines import filleted, oval
from edgemap.simulation.render.mesh import Mesh


def joiners(rng: np.random.Generator) -> list[Mesh]:
    """Straight or bent rear posts up to the back's top, an apron under the seat, arms now and then."""
    seat = drawn_seat(rng, float(rng.uniform(0.43, 0.49)), (0.38, 0.48), float(rng.uniform(0.025, 0.07)))
    timber, radius = wood(rng), float(rng.uniform(0.014, 0.024))
    way = str(rng.choice(legs.WAYS))
    high = float(rng.uniform(0.76, 1.1))
    lean = float(rng.uniform(0.05, 0.25))
    flare = seat.back - 2.0 * radius
    back = Back(
        0.01 - seat.depth / 2.0 + radius,
        seat.top - 0.03,
        high,
        flare,
        flare * float(rng.uniform(0.9, 1.08)),
        lean,
        float(rng.choice([0.0, rng.uniform(0.01, 0.05)])),
    )
    meshes = back.posts(radius, timber, round_=way in ("round", "dowel", "turned"))
    meshes += backs.rails(rng, back, timber, upholstery(rng))
    meshes += legs.four_legs(rng, seat, way, float(rng.choice([0.0, 0.0, rng.uniform(0.01, 0.06)])), radius, timber)
    meshes += cushioned(rng, seat, float(rng.uniform(6.0, 12.0)), timber)
    if way in ("square", "tapered", "turned", "sabre"):
        tall = np.array([0.0, 0.0, float(rng.uniform(0.03, 0.07)) / 2.0])
        a, b, c, d = seat.corners(radius + 0.008) - tall
        for start, end in ((a, b), (b, d), (d, c), (c, a)):
            let_in = (end - start) * 1.1 * radius / float(np.linalg.norm(end - start))
            meshes.append(beam(start + let_in, end - let_in, (2.0 * tall[2], 0.018), timber, across=(0, 0, 1)))
    if rng.random() < 0.2:
        meshes += arms(rng, seat, back, radius, timber)
    return meshes


def windsor(rng: np.random.Generator) -> list[Mesh]:
    """A thick saddle seat with splayed turned legs and a hoop or comb of spindles let into it."""
    seat = drawn_seat(rng, float(rng.uniform(0.43, 0.47)), (0.4, 0.48), 0.04)
    timber = wood(rng)
    high, bow = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.03, 0.08))
    wide = seat.back * float(rng.uniform(0.8, 0.9))
    back = Back(-seat.depth / 2.0 + bow + 0.03, seat.top, high, wide, wide * float(rng.uniform(1.0, 1.1)), 0.22, bow)
    meshes = [plate(seat.outline(float(rng.uniform(2.6, 4.0))), seat.under, seat.top, timber)]
    meshes += legs.four_legs(
        rng,
        Seat(seat.depth * 0.8, seat.front * 0.8, seat.back * 0.8, seat.under, seat.top),
        str(rng.choice(["turned", "turned", "dowel"])),
        float(rng.uniform(0.04, 0.09)),
        float(rng.uniform(0.015, 0.02)),
        timber,
    )
    if rng.random() < 0.6:
        meshes += backs.hoop(rng, back, timber, 0.012, "spindles")
    else:
        tall = back.high - back.low
        meshes.append(back.strip(1.08, np.linspace(1.0 - 0.09 / tall, 1.0, 3), 0.02, timber))
        for at in np.linspace(-1.0, 1.0, int(rng.integers(5, 9))):
            thick = 0.011 if abs(at) == 1.0 else 0.007
            meshes.append(bar(back.at(at * 0.92, -0.03), back.at(at, 0.97), thick, timber, 0.04))
    if rng.random() < 0.25:
        meshes += arms(rng, seat, back, 0.014, timber)
    return meshes


def bentwood(rng: np.random.Generator) -> list[Mesh]:
    """A round seat on bent round legs with a ring between them, and a hoop for a back."""
    wide, top = float(rng.uniform(0.38, 0.43)), float(rng.uniform(0.44, 0.47))
    timber, radius = wood(rng), float(rng.uniform(0.012, 0.016))
    seat = Seat(wide, wide, wide, top - 0.035, top)
    back = Back(-wide * 0.36, top - 0.03, float(rng.uniform(0.82, 0.95)), wide * 0.78, wide * 0.92, 0.18, 0.06)
    shape = oval(wide, wide)
    meshes = [plate(shape, seat.under, top - 0.008, timber)]
    meshes.append(plate(shape * 0.88, top - 0.01, top, woven(rng) if rng.random() < 0.5 else timber))
    tops = np.array([[x, y, seat.under] for x in (0.27, -0.3) for y in (0.27, -0.27)]) * [wide, wide, 1.0]
    out = float(rng.uniform(0.02, 0.05))
    for at in tops:
        foot = at + [np.sign(at[0]) * out, np.sign(at[1]) * out, -at[2]]
        knee = at + [np.sign(at[0]) * out * 0.1, np.sign(at[1]) * out * 0.1, -0.5 * at[2]]
        meshes.append(rod(filleted([at, knee, foot], 0.2), radius, timber))
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1) * wide * 0.4
    if rng.random() < 0.7:
        meshes.append(rod(ring + [0, 0, float(rng.uniform(0.16, 0.26))], radius * 0.7, timber, closed=True))
    filling = str(rng.choice(["hoop", "hoop", "spindles", "board", "cane"]))
    meshes += backs.hoop(rng, back, timber, radius, filling)
    if rng.random() < 0.2:
        meshes += arms(rng, Seat(wide * 0.8, wide * 0.9, wide, seat.under, top), back, radius, timber)
    return meshes
