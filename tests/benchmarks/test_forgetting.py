"""Counts of the forgetting benchmark by hand."""

import numpy as np
import pytest

from edgemap.geometry.map_object import MapObject


def mapped(identity, x_m, y_m):
    label = identity.rpartition("-")[0]
    return MapObject(identity, label, np.array([x_m, y_m]), np.eye(2) * 0.01, 0.5, 0.8, 9, 0.9, 0.0, 1.0)


@pytest.mark.parametrize(
    ("left", "looks", "expected"),
    [
        ({"chair-1": 6}, {"chair-1": 6}, {"absent": 1, "forgotten": 1}),
        ({"chair-1": 12}, {"chair-1": 12}, {"absent": 1, "forgotten": 0}),
        ({}, {"chair-1": 10}, {"absent": 1, "forgotten": 0}),
        ({}, {"chair-1": 9}, {"unlooked": 1, "absent": 0}),
        ({"chair-2": 5}, {"chair-1": 3}, {"lost": 1, "unlooked": 1}),
        ({"vase-1": 5}, {"chair-1": 3}, {"false": 1, "false_gone": 1}),
    ],
)
def test_counts(left, looks, expected):
    from edgemap.benchmarks.forgetting import score

    saved = [mapped("chair-1", 1.0, 0.2), mapped("chair-2", 3.0, 0.0), mapped("vase-1", 3.0, 0.0)]
    was = [("chair", 1.0, 0.0, False), ("chair", 3.0, 0.3, True), ("vase", 6.0, 0.0, True)]
    counts = score(saved, was, left, looks, [item for item in saved if item.id not in left])
    assert {name: counts[name] for name in expected} == expected
    assert (counts["present"], counts["false"]) == (1, 1)


def test_a_present_object_under_a_new_id_is_not_lost():
    from edgemap.benchmarks.forgetting import score

    was = [("chair", 3.0, 0.3, True)]
    counts = score([mapped("chair-2", 3.0, 0.0)], was, {"chair-2": 8}, {"chair-2": 8}, [mapped("chair-5", 3.1, 0.3)])
    assert (counts["present"], counts["lost"]) == (1, 0)
