import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.overlap_suppression import OTHER_LABEL, SAME_LABEL, without_overlaps
from edgemap.geometry.observations.class_extents import extent_m, footprint_m


def thing(identity, x_m, y_m=0.0, count=10, confidence=0.9):
    return MapObject(
        identity, identity.rpartition("-")[0], np.array([x_m, y_m]), np.eye(2) * 0.01, 0.5, 0.8, count, confidence, 0, 1
    )


def test_a_chair_in_the_place_of_a_better_seen_chair_goes():
    """A chair takes 0.5 m: two middles are at least 0.4 m apart."""
    kept = without_overlaps([thing("chair-1", 0.0, count=4), thing("chair-2", 0.39), thing("chair-3", 0.81)])
    assert [item.id for item in kept] == ["chair-2", "chair-3"]


def test_chairs_side_by_side_stay():
    assert len(without_overlaps([thing("chair-1", 0.0, count=3), thing("chair-2", 0.45, count=30)])) == 2


def test_chairs_pushed_together_are_seen_about_as_often_and_stay():
    assert len(without_overlaps([thing("chair-1", 0.0, count=20), thing("chair-2", 0.1, count=30)])) == 2


def test_one_thing_called_by_two_names_keeps_the_better_one():
    kept = without_overlaps([thing("backpack-1", 0.0, count=11), thing("suitcase-1", 0.1)])
    assert [item.id for item in kept] == ["backpack-1"]


def test_a_vase_close_to_a_chair_stays():
    """0.2 and 0.5 m wide, side by side they are 0.35 m apart; less than 0.21 m, and they stand in one another."""
    assert len(without_overlaps([thing("chair-1", 0.0, count=50), thing("vase-1", 0.22)])) == 2
    assert len(without_overlaps([thing("chair-1", 0.0, count=50), thing("vase-1", 0.20)])) == 1


def test_an_armchair_called_a_couch_too_is_one_thing():
    """A couch is 0.9 m deep: 0.42 m from its middle is no room for a chair."""
    kept = without_overlaps([thing("chair-1", 0.0, count=50), thing("couch-1", 0.4, count=30)])
    assert [item.id for item in kept] == ["chair-1"]


def test_what_goes_does_not_take_others_with_it():
    """The middle chair goes for the first one; the third is near the middle one only."""
    chairs = [thing("chair-1", 0.0, count=50), thing("chair-2", 0.3, count=20), thing("chair-3", 0.6, count=8)]
    assert [item.id for item in without_overlaps(chairs)] == ["chair-1", "chair-3"]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["chair", "vase", "couch"]),
            st.floats(0, 3),
            st.floats(0, 3),
            st.integers(1, 99),
        ),
        max_size=12,
    )
)
def test_nothing_overlaps_and_everything_dropped_has_a_better_neighbour(rows):
    objects = [thing(f"{label}-{n}", x, y, count) for n, (label, x, y, count) in enumerate(rows)]
    kept = without_overlaps(objects)

    def apart(a, b):
        extents = [extent_m(item.label, item.width_m) for item in (a, b)]
        sides = [min(footprint_m(item.label, item.width_m)) for item in (a, b)]
        least = SAME_LABEL * min(extents) if a.label == b.label else OTHER_LABEL * sum(sides) / 2
        return np.linalg.norm(a.position_m - b.position_m) >= least - 1e-9

    def clear(a, b):
        return a.count * (2 if a.label == b.label else 1) >= b.count

    assert all(apart(a, b) or clear(a, b) or clear(b, a) for a in kept for b in kept if a is not b)
    assert all(apart(a, b) or a.label == b.label or a.count == b.count for a in kept for b in kept)
    for item in objects:
        if item not in kept:
            assert any(not apart(item, other) and not clear(item, other) for other in kept)
