"""Furnished homes, deterministic per seed, and those with some furniture moved or removed, to test forgetting.

Home frame: x right, y far, z up, metres, origin at the low corner.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from edgemap.simulation.apartment.draw_plan import draw_plan
from edgemap.simulation.apartment.furniture import Purpose
from edgemap.simulation.apartment.layout import ALIVE, SIDES, Layout, Placed
from edgemap.simulation.apartment.plan import ApartmentPlan
from edgemap.simulation.apartment.rooms import furnish_room
from edgemap.simulation.errors import SimulationError

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


# Nobody carries these elsewhere between two drives.
_FIXTURES = frozenset({"toilet", "sink", "oven", "refrigerator"})
# Old and new places of one label stay so far apart that no map can take one for another.
_APART_M = 1.2
_TRIES = 80


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes of a home: removed pieces, and moved pieces before and after (ids stay)."""

    removed: tuple[Placed, ...]
    moved: tuple[tuple[Placed, Placed], ...]


def move_furniture(apartment: Apartment, count: int, rng: np.random.Generator) -> tuple[Apartment, Changes]:
    """The home with `count` labelled pieces of its floor removed and as many put to other free places.

    Everything else stays. Fixtures, and pieces that carry others, are not moved. Raises SimulationError where the home
    has too few pieces that can be moved.
    """
    candidates = [item for item in apartment.furniture if _movable(item, apartment.furniture)]
    order = [candidates[row] for row in rng.permutation(len(candidates)).tolist()]
    removed, movers = order[:count], order[count:]
    left: list[Placed] = [item for item in apartment.furniture if item not in removed]
    moved: list[tuple[Placed, Placed]] = []
    for item in movers:
        if len(moved) == count:
            break
        others = [other for other in left if other is not item]
        shunned = [other for other in (*apartment.furniture, *left) if other.label == item.label]
        place = _elsewhere(apartment, item, others, shunned, rng)
        if place is not None:
            moved.append((item, place))
            left = [place if other is item else other for other in left]
    if len(moved) < count:
        raise SimulationError(
            f"of the home's {len(candidates)} pieces that can be moved {len(removed)} were to go and {count} to be put "
            f"elsewhere, but only {len(moved)} found a free place"
        )
    return Apartment(apartment.plan, tuple(left), before=apartment), Changes(tuple(removed), tuple(moved))


def _movable(item: Placed, furniture: tuple[Placed, ...]) -> bool:
    if not item.label or not item.on_floor or item.label in ALIVE or item.label in _FIXTURES:
        return False
    half = np.array([item.model.depth_m, item.model.width_m]) / 2.0
    for other in furniture:
        middle = item.pose_home_object.inverse().apply(other.middle_home_m)
        if not other.on_floor and (np.abs(middle) < half).all() and other.z_m < item.model.height_m + 0.1:
            return False
    return True


def _elsewhere(
    apartment: Apartment, item: Placed, others: list[Placed], shunned: list[Placed], rng: np.random.Generator
) -> Placed | None:
    """The piece near a wall of any room, far from present and former places of its label; None where that fails."""
    plan, home = apartment.plan, Layout(apartment.plan, "test", rng)  # no models are drawn
    for other in others:
        home.boxes.add(other.footprint_home_m(), other.z_m, other.z_m + other.model.height_m, other.id)
        home.floor.takes(other.footprint_home_m(), other.z_m)
    taken = np.array([other.middle_home_m for other in shunned])
    for _ in range(_TRIES):
        room, side = plan.rooms[home.count(0, len(plan.rooms) - 1)], SIDES[home.count(0, len(SIDES) - 1)]
        pose = home.wall_pose(item.model, room, side, home.uniform(0.0, 1.0), home.uniform(0.05, 0.4))
        if np.hypot(*(taken - [pose.x_m, pose.y_m]).T).min() < _APART_M:
            continue
        turn = home.uniform(-0.4, 0.4) if item.label in {"couch", "bed"} else home.uniform(-math.pi, math.pi)
        for yaw in (turn, 0.0):
            place = replace(item, pose_home_object=replace(pose, yaw_rad=pose.yaw_rad + yaw))
            if home.settle(place, room):
                return place
    return None
