"""Stools."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK, metal, wood
from edgemap.simulation.apartment.made.seats import backs, legs
from edgemap.simulation.apartment.made.seats.backs import Back
from edgemap.simulation.apartment.made.seats.seat import Seat, cushioned
from edgemap.simulation.apartment.made.shapes.bars import bar, rod, tube
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.render.mesh import Mesh


def stool(rng: np.random.Generator) -> Mesh:
    """A stool, mostly for a bar, with or without a low back."""
    tall = rng.random() < 0.7
    top = float(rng.uniform(0.62, 0.8) if tall else rng.uniform(0.42, 0.5))
    wide = float(rng.uniform(0.3, 0.42))
    seat = Seat(wide, wide, wide, top - float(rng.uniform(0.025, 0.07)), top)
    body = wood(rng) if rng.random() < 0.6 else metal(rng)
    square = float(rng.choice([2.0, 2.0, 4.0, 7.0]))
    meshes = cushioned(rng, seat, square, body)
    low = top * float(rng.uniform(0.25, 0.45))
    if rng.random() < 0.3:
        meshes += legs.pedestal(rng, seat.under, metal(rng), float(rng.uniform(0.19, 0.24)))
        if tall:
            turn = np.linspace(0.0, 2.0 * np.pi, 21)[:, None]
            ring = np.hstack([0.15 * np.cos(turn), 0.15 * np.sin(turn), np.full_like(turn, low)])
            meshes += [rod(ring, 0.009, metal(rng), closed=True), tube((0, 0.15, low), (0, -0.15, low), 0.008, BLACK)]
    else:
        count = int(rng.choice([3, 4, 4]))
        turns = 2.0 * np.pi * (np.arange(count) + 0.5) / count
        reach, out = wide * (0.36 if square < 3 else 0.52), float(rng.uniform(0.0, 0.1)) * (top / 0.7)
        around = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
        if count == 3 and square > 3:
            reach *= 0.7
        tops, feet = around * reach + [0, 0, seat.under], around * (reach + out)
        way, radius = str(rng.choice(legs.WAYS[:6])), float(rng.uniform(0.012, 0.02))
        meshes += [legs.leg(way, a, b, radius, body) for a, b in zip(tops, feet, strict=True)]
        bars = tops + (tops[:, 2:] - low) / tops[:, 2:] * (feet - tops)
        meshes += [
            bar(a, b, radius * 0.6, body, 1.5 * radius) for a, b in zip(bars, np.roll(bars, 1, axis=0), strict=True)
        ]
    if rng.random() < 0.35:
        high = top + float(rng.uniform(0.15, 0.35))
        back = Back(-wide * 0.42, top - 0.03, high, wide * 0.8, wide * 0.9, float(rng.uniform(0.05, 0.2)), 0.05)
        if rng.random() < 0.5:
            meshes += backs.hoop(rng, back, body, 0.01, str(rng.choice(["spindles", "hoop", "board"])))
        else:
            meshes += back.posts(0.012, body, round_=True)
            meshes.append(back.strip(1.05, np.linspace(0.5, 1.0, 4), 0.02, body))
    return joined(meshes)
