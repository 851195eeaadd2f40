"""Measures and materials of upholstered seats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import upholstery
from edgemap.simulation.apartment.made.materials.plain import metal, wood
from edgemap.simulation.render.mesh import Material

_ARMS = (0.26, 0.1, 0.18, 0.16, 0.12, 0.12, 0.06)


@dataclass(frozen=True, slots=True)
class Plan:
    """Measures (metres), manner and materials of one upholstered piece.

    width: of all seats, without arms. depth: of the seat, in front of the back. seat, rest, high: heights of seat,
    arms and back. lift: of its base above the floor. soft: radius of its edges.
    """

    seats: int
    width: float
    depth: float
    seat: float
    rest: float
    high: float
    lift: float
    back: float
    arm: float
    arms: str
    lean: float
    soft: float
    swell: float
    cover: Material
    cushions: Material
    legs: Material


def plan(rng: np.random.Generator, seats: int, arms: str | None = None) -> Plan:
    """A piece of so many seats; arms: box, round, slim, pillow, frame or none."""
    one = float(rng.uniform(0.52, 0.72)) if seats < 4 else float(rng.uniform(0.5, 0.62))
    seat = float(rng.uniform(0.38, 0.47))
    way = arms or str(rng.choice(["box", "box", "round", "slim", "pillow", "frame", "none"], p=_ARMS))
    widths = {
        "none": (0.0, 0.001),
        "box": (0.12, 0.26),
        "round": (0.16, 0.24),
        "slim": (0.05, 0.1),
        "pillow": (0.18, 0.28),
        "frame": (0.05, 0.08),
    }
    cover = upholstery(rng)
    return Plan(
        seats=seats,
        width=one * seats,
        depth=float(rng.uniform(0.5, 0.64)),
        seat=seat,
        rest=seat + float(rng.uniform(0.1, 0.26)),
        high=float(rng.uniform(0.7, 0.98)),
        lift=float(rng.choice([0.015, rng.uniform(0.04, 0.1), rng.uniform(0.1, 0.2)])),
        back=float(rng.uniform(0.12, 0.22)),
        arm=float(rng.uniform(*widths[way])),
        arms=way,
        lean=float(rng.uniform(0.05, 0.28)),
        soft=float(rng.uniform(0.015, 0.07)),
        swell=float(rng.uniform(0.0, 0.16)),
        cover=cover,
        cushions=cover if rng.random() < 0.75 else upholstery(rng),
        legs=wood(rng) if rng.random() < 0.7 else metal(rng),
    )
