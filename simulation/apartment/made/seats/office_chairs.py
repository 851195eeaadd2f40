"""Office chairs."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import leather, upholstery
from edgemap.simulation.apartment.made.materials.plain import BLACK, metal, plastic
from edgemap.simulation.apartment.made.seats import backs, legs
from edgemap.simulation.apartment.made.seats.backs import Back
from edgemap.simulation.apartment.made.seats.seat import drawn_seat
from edgemap.simulation.apartment.made.seats.shells import shell
from edgemap.simulation.apartment.made.shapes.bars import beam, rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import pad
from edgemap.simulation.apartment.made.shapes.outlines import filleted, oval
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Mesh


def office_chair(rng: np.random.Generator) -> Mesh:
    """A swivel chair: star foot, mostly on castors, gas lift, padded or netted back, with or without arms."""
    top = float(rng.uniform(0.42, 0.54))
    seat = drawn_seat(rng, top, (0.42, 0.54), 0.05)
    frame = BLACK if rng.random() < 0.6 else metal(rng)
    cover = upholstery(rng) if rng.random() < 0.6 else leather(rng)
    meshes = legs.star(rng, seat.under, frame, castors=rng.random() < 0.85)
    executive = rng.random() < 0.35
    high = top + float(rng.uniform(0.6, 0.78) if executive else rng.uniform(0.32, 0.6))
    if rng.random() < 0.15:
        meshes.append(shell(rng, seat, min(high, top + 0.5), plastic(rng), 0.015, float(rng.uniform(0.0, 0.12))))
        return joined(meshes)
    meshes.append(beam((-0.12, 0, seat.under - 0.02), (0.12, 0, seat.under - 0.02), (0.16, 0.04), BLACK))
    shape = seat.outline(float(rng.uniform(3.0, 6.0)))
    meshes.append(pad(shape, seat.under, top, cover, 0.02))
    gap = 0.02 if executive else float(rng.uniform(0.04, 0.2))
    wide = seat.back * float(rng.uniform(0.8, 1.0))
    lean = float(rng.uniform(0.08, 0.25))
    back = Back(-seat.depth / 2.0 + 0.01, top + gap, high, wide, wide * float(rng.uniform(0.75, 1.0)), lean, 0.05)
    behind = plastic(rng) if rng.random() < 0.3 else None
    meshes.append(
        backs.upholstered(
            back, 0.1 if executive else float(rng.uniform(0.02, 0.07)), cover, float(rng.uniform(2.5, 8.0)), behind
        )
    )
    if not executive and rng.random() < 0.2:
        rest = Back(back.x - lean * (high - back.low), high + 0.04, high + 0.17, 0.26, 0.24, lean, 0.02)
        meshes += [
            backs.upholstered(rest, 0.05, cover, 4.0),
            tube(back.at(0, 0.8), rest.at(0, 0.5), 0.012, frame),
        ]
    spine = np.array(
        [
            (-0.08, 0.0, seat.under - 0.02),
            (-seat.depth / 2.0 - 0.06, 0.0, seat.under - 0.02),
            back.at(0.0, 0.6) - [0.02, 0, 0],
        ]
    )
    meshes.append(rod(filleted(spine, 0.09), 0.022, frame, 0.6))
    if executive or rng.random() < 0.6:
        y, rest_z = seat.front / 2.0 + 0.04, top + float(rng.uniform(0.17, 0.25))
        loop = rng.random() < 0.5
        for side in (y, -y):
            flat = [(0.0, side * 0.6, seat.under + 0.01), (0.02, side, seat.under + 0.01), (0.02, side, rest_z)]
            if loop:
                flat = [
                    (0.1, side * 0.8, seat.under + 0.01),
                    (0.14, side, rest_z),
                    (-0.14, side, rest_z),
                    (-0.1, side * 0.8, seat.under + 0.01),
                ]
            meshes.append(rod(filleted(flat, 0.06), 0.016, frame, 0.7))
            rest = pad(oval(0.26, 0.07, 5.0, width_behind=0.06), rest_z, rest_z + 0.03, BLACK, 0.005)
            meshes.append(rest.placed(0.0, side, 0.0, 0.0))
    return joined(meshes)
