"""Rooms and doors against a plan by hand: two rooms of 3 x 4 m, a door, and a third that nobody saw."""

import numpy as np
import pytest

from edgemap.evaluation.rooms import TruePlan, score_rooms
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.se2 import SE2


def box(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


PLAN = TruePlan(
    [box(0, 0, 3, 4), box(3.1, 0, 6, 4), box(6.1, 0, 9, 4)],
    ["kitchen", "study", "bedroom"],
    [box(3, 1.5, 3.1, 2.5), box(6, 0, 6.1, 0.8)],
    [box(3, 0, 3.1, 1.5), box(3, 2.5, 3.1, 4), box(6, 0.8, 6.1, 4), box(6, 0, 6.1, 0.8), box(-0.1, 0, 0, 4)],
)
POSES = [SE2(x, 2.0, yaw) for x in (1.5, 4.5) for yaw in np.linspace(0.0, 6.0, 12)]


def scored(rooms, doors):
    return score_rooms(rooms, doors, PLAN, POSES, 1.0)


def test_only_what_was_seen_is_asked_for_and_judged():
    rooms = [Room("room-1", tuple(map(tuple, box(0, 0, 3, 3.2))), "kitchen"), Room("room-2", ((9, 9), (9, 8), (8, 8)))]
    door = Door("door-1", (3.0, 1.7), (3.0, 2.6), ("room-1", "room-2"), 0.9)
    figures = scored([*rooms, Room("room-3", tuple(map(tuple, PLAN.rooms[2])))], [door])
    assert figures["rooms"] == {"found": 0.5, "mean_iou": pytest.approx(0.8, abs=0.02), "precision": 0.5, "kinds": 1.0}
    assert figures["doors"] == {"precision": 1.0, "recall": 1.0}
    wrong = Door("door-2", (1.0, 1.0), (2.0, 1.0), ("room-1", "room-2"), 0.9)
    assert scored(rooms, [wrong])["doors"] == {"precision": 0.0, "recall": 0.0}


def test_an_empty_map_finds_nothing():
    assert scored([], []) == {
        "rooms": {"found": 0.0, "mean_iou": None, "precision": None, "kinds": None},
        "doors": {"precision": None, "recall": 0.0},
    }
