import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.objects.class_posterior import Candidate, OverlapRule, Overlaps, label_posterior
from edgemap.geometry.observations.class_extents import extent_m, footprint_m

RULE = OverlapRule()


def mapped(identity, x_m, y_m=0.0, count=10):
    return Candidate(identity, identity.rpartition("-")[0], np.array([x_m, y_m]), 0.5, float(count))


def without_overlaps(candidates, order=None):
    """The best candidate of each object, in the order given."""
    overlaps = Overlaps()
    for row in order or range(len(candidates)):
        overlaps.set(candidates[row])
        overlaps.settle()
    assert {item.id for members in overlaps.members.values() for item in members} == {c.id for c in candidates}
    return [item for item in candidates if item.id in overlaps.members]


def test_a_chair_in_the_place_of_a_better_seen_chair_goes():
    """A chair takes 0.5 m: two middles are at least 0.4 m apart."""
    kept = without_overlaps([mapped("chair-1", 0.0, count=4), mapped("chair-2", 0.39), mapped("chair-3", 0.81)])
    assert [item.id for item in kept] == ["chair-2", "chair-3"]


def test_chairs_side_by_side_stay():
    assert len(without_overlaps([mapped("chair-1", 0.0, count=3), mapped("chair-2", 0.45, count=30)])) == 2


def test_chairs_pushed_together_are_seen_about_as_often_and_stay():
    assert len(without_overlaps([mapped("chair-1", 0.0, count=20), mapped("chair-2", 0.1, count=30)])) == 2


def test_one_thing_called_by_two_names_keeps_the_better_one():
    kept = without_overlaps([mapped("backpack-1", 0.0, count=11), mapped("suitcase-1", 0.1)])
    assert [item.id for item in kept] == ["backpack-1"]


def test_a_vase_close_to_a_chair_stays():
    """0.2 and 0.5 m wide, side by side they are 0.35 m apart; less than 0.21 m, and they stand in one another."""
    assert len(without_overlaps([mapped("chair-1", 0.0, count=50), mapped("vase-1", 0.22)])) == 2
    assert len(without_overlaps([mapped("chair-1", 0.0, count=50), mapped("vase-1", 0.20)])) == 1


def test_a_chair_pushed_under_a_table_stays():
    """Half the sum of the shorter sides is 0.7 m: other things less than 0.42 m apart stand in one another."""
    assert len(without_overlaps([mapped("dining table-1", 0.0, count=25), mapped("chair-1", 0.3, count=11)])) == 2
    assert len(without_overlaps([mapped("dining table-1", 0.0, count=25), mapped("chair-1", 0.1, count=11)])) == 1
    assert len(without_overlaps([mapped("dining table-1", 0.0, count=25), mapped("bed-1", 0.3, count=11)])) == 1


def test_a_name_given_rarely_beside_another_is_the_other_object():
    """Under a fifth of the sightings: 0.35 m is too near."""
    assert len(without_overlaps([mapped("chair-1", 0.0, count=50), mapped("vase-1", 0.34, count=9)])) == 1
    assert len(without_overlaps([mapped("chair-1", 0.0, count=50), mapped("vase-1", 0.36, count=9)])) == 2
    assert len(without_overlaps([mapped("chair-1", 0.0, count=50), mapped("vase-1", 0.34, count=11)])) == 2


def test_the_posterior_of_a_label_is_bayes_over_its_sightings():
    """30 / 4 independent sightings of a couch against 3 / 4 of a suitcase, each nine to one."""
    found = label_posterior({"suitcase": 3.0, "couch": 30.0}, RULE)
    assert list(found) == ["couch", "suitcase"]
    assert found["suitcase"] / found["couch"] == pytest.approx(9.0 ** (-27.0 / 4.0))
    assert label_posterior({"chair": 2.0, "bed": 2.0}, RULE) == {"bed": 0.5, "chair": 0.5}
    assert label_posterior({"chair": 0.0}, RULE) == {"chair": 1.0}


def test_an_armchair_called_a_couch_too_is_one_object():
    """A couch is 0.9 m deep: 0.42 m from its middle is no room for a chair."""
    kept = without_overlaps([mapped("chair-1", 0.0, count=50), mapped("couch-1", 0.4, count=30)])
    assert [item.id for item in kept] == ["chair-1"]


def test_what_goes_does_not_take_others_with_it():
    """The middle chair goes for the first one; the third is near the middle one only."""
    chairs = [mapped("chair-1", 0.0, count=50), mapped("chair-2", 0.3, count=20), mapped("chair-3", 0.6, count=8)]
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
def test_nothing_overlaps_and_the_order_of_changes_does_not_matter(rows):
    objects = [mapped(f"{label}-{n}", x, y, count) for n, (label, x, y, count) in enumerate(rows)]
    kept = without_overlaps(objects)
    order = np.random.default_rng(len(rows)).permutation(len(rows)).tolist()
    assert [item.id for item in without_overlaps(objects, order)] == [item.id for item in kept]

    def stand_apart(a, b):
        extents = [extent_m(item.label, item.width_m) for item in (a, b)]
        sides = [min(footprint_m(item.label, item.width_m)) for item in (a, b)]
        less, more = sorted((a.evidence, b.evidence))
        if a.label == b.label:
            least = RULE.same_label * min(extents) if less < RULE.far_less * more else 0.0
        else:
            least = (RULE.rare_label if less < RULE.rare * more else RULE.other_label) * sum(sides) / 2
        return np.linalg.norm(a.position_m - b.position_m) >= least - 1e-9

    assert all(stand_apart(a, b) for a in kept for b in kept if a is not b)
    for item in objects:
        if item not in kept:
            assert any(not stand_apart(item, other) and other.evidence >= item.evidence for other in kept)
