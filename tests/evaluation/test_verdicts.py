import numpy as np
import pytest

from edgemap.evaluation.objects import TrueObject, evaluation_rows, score_map
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.evaluation_row import tally


def mapped(identity, x, y, sigma=0.1):
    label = identity.rpartition("-")[0]
    return MapObject(identity, label, np.array([x, y]), np.eye(2) * sigma**2, 0.5, 0.9, 9, 1.0, 0.0, 1.0)


def true(label, x, y, frames=50, on_floor=True):
    return TrueObject(label, x, y, on_floor, frames)


def test_every_state_by_hand():
    objects = [mapped("chair-1", 1.2, 0), mapped("chair-2", 4, 1.2), mapped("chair-3", 9, 9), mapped("couch-1", 1, 0)]
    truth = [true("chair", 1, 0), true("chair", 4, 0), true("bed", -3, 0), true("couch", 1, 0.1, frames=3)]
    rows = evaluation_rows(objects, truth)
    assert [(row.state, row.label, row.object_id) for row in rows] == [
        ("found", "chair", "chair-1"),
        ("misplaced", "chair", "chair-2"),
        ("missed", "bed", None),
        ("extra", "chair", "chair-3"),
        ("unscored", "couch", "couch-1"),
    ]
    assert [row.error_m for row in rows[:2]] == pytest.approx([0.2, 1.2])
    assert [row.covered for row in rows[:2]] == [True, False]  # 2 sigma inside the ellipse (2.45), 12 sigma not
    assert rows[2].true_m == (-3, 0)
    assert tally(rows) == "1 found, 1 misplaced, 1 missed, 1 extra, 1 unscored"


def test_too_far_for_misplaced_is_one_missed_and_one_extra():
    rows = evaluation_rows([mapped("chair-1", 1.6, 0)], [true("chair", 0, 0)])
    assert [row.state for row in rows] == ["missed", "extra"]


def test_what_is_not_on_the_floor_is_neither_wanted_nor_excused():
    assert [row.state for row in evaluation_rows([mapped("tv-1", 0, 0)], [true("tv", 0, 0, on_floor=False)])] == [
        "extra"
    ]


def test_the_table_agrees_with_the_score():
    random = np.random.default_rng(3)
    for _ in range(30):
        objects = [mapped(f"chair-{i}", *random.uniform(0, 3, 2)) for i in range(random.integers(0, 7))]
        truth = [true("chair", *random.uniform(0, 3, 2), frames=int(random.integers(5, 20))) for _ in range(5)]
        rows, figures = evaluation_rows(objects, truth), score_map(objects, truth)
        states = [row.state for row in rows]
        assert states.count("found") == figures["objects_found"]
        assert len(states) - states.count("missed") == len(objects)
        assert sum(states.count(name) for name in ("found", "misplaced", "missed")) == figures["objects_true"]
