"""Furnished homes, deterministic per seed. Home frame: x right, y far, z up, metres, origin at the low corner."""

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.draw_plan import draw_plan
from edgemap.simulation.apartment.furniture import Purpose
from edgemap.simulation.apartment.layout import ALIVE, Layout, Placed
from edgemap.simulation.apartment.plan import ApartmentPlan
from edgemap.simulation.apartment.rooms import furnish_room

__all__ = ["Apartment", "Placed", "furnish", "purpose_of"]

_VALIDATION_FROM_SEED, _TEST_FROM_SEED = 8000, 9000
_FROZEN_SEEDS = range(9200, 9300)
# A home with fewer labelled pieces on its floor gets more of what can stand anywhere.
_LEAST_PIECES = 15
_FILLERS = ("potted plant", "chair", "armchair", "chair", "stool", "suitcase", "potted plant", "vase", "backpack")
_SEATS = {"chair", "armchair", "stool"}


@dataclass(frozen=True, slots=True)
class Apartment:
    """A plan and its furniture. before: the home as it was, where furniture was moved since: its walls stay as then."""

    plan: ApartmentPlan
    furniture: tuple[Placed, ...]
    before: "Apartment | None" = None


def purpose_of(seed: int) -> Purpose:
    """Purpose of a seed's home: from 8000 validation, from 9000 test, 9200-9299 frozen."""
    if seed in _FROZEN_SEEDS:
        return "frozen"
    return "training" if seed < _VALIDATION_FROM_SEED else "validation" if seed < _TEST_FROM_SEED else "test"


def furnish(seed: int) -> Apartment:
    """The home of a seed: to train on with models of our own beside the libraries', to test with held-out ones."""
    rng = np.random.default_rng(seed)
    plan = draw_plan(rng)
    home = Layout(plan, purpose_of(seed), rng)
    clutter = home.uniform(0.0, 1.0)
    for room in plan.rooms:
        furnish_room(home, room, len(plan.rooms) == 1, clutter)
    for _ in range(3 * _LEAST_PIECES):
        if sum(item.on_floor and item.label not in {"", *ALIVE} for item in home.placed) >= _LEAST_PIECES:
            break
        room = plan.rooms[home.count(0, len(plan.rooms) - 1)]
        kind = _FILLERS[home.count(0, len(_FILLERS) - 1)]
        home.against_wall(kind, room) if kind in _SEATS else home.by_wall(kind, room)
    return Apartment(plan, tuple(home.placed))
