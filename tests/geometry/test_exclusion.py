import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.map_object import SightingSums
from edgemap.geometry.objects.candidates import APART, Candidate, OverlapRule, Overlaps, label_posterior
from edgemap.geometry.observations.class_extents import extent_m, footprint_m

RULE = OverlapRule()


def mapped(identity, x_m, y_m=0.0, count=10):
    sums = SightingSums(1, weight=float(count), width_m=0.5, miss=-np.inf)
    return Candidate(identity, identity.rpartition("-")[0], [], position_m=np.array([x_m, y_m]), sums=sums)


def put(item, candidates, overlaps):
    candidates[item.id] = item
    overlaps.change(item.id)


def without_overlaps(candidates, order=None):
    """The best candidate of each object, in the order given."""
    listed = dict[str, Candidate]()
    overlaps = Overlaps(listed)
    for item in [candidates[row] for row in order or range(len(candidates))]:
        put(item, listed, overlaps)
        overlaps.settle()
    assert {item.id for members in overlaps.members.values() for item in members} == {c.id for c in candidates}
    return [item for item in candidates if item.id in overlaps.members]


STAND = [  # (id, x in m, sightings), and the ids that stay
    # A chair takes 0.5 m: two middles are at least 0.4 m apart, unless both were observed about as often.
    ([("chair-1", 0.0, 4), ("chair-2", 0.39, 10), ("chair-3", 0.81, 10)], "chair-2 chair-3"),
    ([("chair-1", 0.0, 3), ("chair-2", 0.45, 30)], "chair-1 chair-2"),
    ([("chair-1", 0.0, 20), ("chair-2", 0.1, 30)], "chair-1 chair-2"),
    # One object under two labels keeps the better one: a chair is 0.5 m deep, so its middle is 0.4 m from a couch's.
    ([("backpack-1", 0.0, 11), ("suitcase-1", 0.1, 10)], "backpack-1"),
    ([("chair-1", 0.0, 50), ("couch-1", 0.39, 30)], "chair-1"),
    ([("chair-1", 0.0, 50), ("couch-1", 0.41, 30)], "chair-1 couch-1"),
    # A vase is 0.2 m wide: less than 0.16 m from the middle of another object it stands in that.
    ([("chair-1", 0.0, 50), ("vase-1", 0.17, 10)], "chair-1 vase-1"),
    ([("chair-1", 0.0, 50), ("vase-1", 0.15, 10)], "chair-1"),
    # Chairs stand under a table, beds do not.
    ([("dining table-1", 0.0, 25), ("chair-1", 0.1, 11)], "dining table-1 chair-1"),
    ([("dining table-1", 0.0, 25), ("bed-1", 0.3, 11)], "dining table-1"),
    ([("chair-1", 0.0, 50), ("vase-1", 0.36, 9)], "chair-1 vase-1"),
    ([("chair-1", 0.0, 50), ("vase-1", 0.34, 11)], "chair-1 vase-1"),
    # The middle chair goes for the first one; the third is near the middle one only.
    ([("chair-1", 0.0, 50), ("chair-2", 0.3, 20), ("chair-3", 0.6, 8)], "chair-1 chair-3"),
]


@pytest.mark.parametrize(("objects", "kept"), STAND)
def test_of_what_stands_in_one_another_the_better_observed_stays(objects, kept):
    found = without_overlaps([mapped(identity, x_m, count=count) for identity, x_m, count in objects])
    assert " ".join(item.id for item in found) == kept


def test_the_posterior_of_a_label_is_bayes_over_its_sightings():
    """30 / 4 independent sightings of a couch against 3 / 4 of a suitcase, each nine to one."""
    found = label_posterior({"suitcase": 3.0, "couch": 30.0}, RULE)
    assert list(found) == ["couch", "suitcase"]
    assert found["suitcase"] / found["couch"] == pytest.approx(9.0 ** (-27.0 / 4.0))
    assert label_posterior({"chair": 2.0, "bed": 2.0}, RULE) == {"bed": 0.5, "chair": 0.5}
    assert label_posterior({"chair": 0.0}, RULE) == {"chair": 1.0}


ROW = st.tuples(st.sampled_from(["chair", "vase", "couch"]), st.floats(0, 3), st.floats(0, 3), st.integers(1, 99))
ROWS = st.lists(ROW, max_size=12)


@given(ROWS, st.integers(0, 999))
def test_what_changed_and_came_back_is_as_if_it_had_never_changed(rows, seed):
    """Candidates that moved, that were observed more often, and that were gone for a while."""
    objects = [mapped(f"{label}-{n}", x, y, count) for n, (label, x, y, count) in enumerate(rows)]
    random, listed, others = np.random.default_rng(seed), dict[str, Candidate](), dict[str, Candidate]()
    overlaps, fresh = Overlaps(listed), Overlaps(others)
    for item in [item for item in objects for _ in range(3)]:
        at = item.position_m + random.normal(0.0, 0.3, 2)
        put(mapped(item.id, *at, random.integers(1, 99)), listed, overlaps)
        if random.random() < 0.3:
            overlaps.settle()
            del listed[item.id]
            overlaps.change(item.id)
        if random.random() < 0.5:
            overlaps.settle()
    for found, known in ((overlaps, listed), (fresh, others)):
        for item in objects:
            put(item, known, found)
        found.settle()
        assert {found.best(item.id) for item in objects} == set(found.members)
    assert overlaps.members == fresh.members
    for item in objects[::2]:
        del listed[item.id]
        overlaps.change(item.id)
    overlaps.settle()
    assert all(overlaps.best(item.id) == item.id for item in objects[::2])
    assert {one.id for own in overlaps.members.values() for one in own} == {item.id for item in objects[1::2]}


@given(ROWS)
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
            least = APART * min(extents) if less < RULE.far_less * more else 0.0
        else:
            least = APART * min(sides)
        return np.linalg.norm(a.position_m - b.position_m) >= least - 1e-9

    assert all(stand_apart(a, b) for a in kept for b in kept if a is not b)
    for item in objects:
        if item not in kept:
            assert any(not stand_apart(item, other) and other.evidence >= item.evidence for other in kept)
