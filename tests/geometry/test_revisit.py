import numpy as np

from edgemap.geometry.slam import loop_hypotheses
from edgemap.geometry.slam.loop_hypotheses import LoopHypothesisRule, Pairing

RULE = LoopHypothesisRule()
OWN = 0.02**2 + 0.1**2 / 2.0  # m^2, of each object's position by itself, seen from one side


def certain_pairings(*arguments, **options):
    """The result, whatever the units of work."""
    work = loop_hypotheses.certain_pairings(*arguments, **options)
    try:
        while True:
            next(work)
    except StopIteration as end:
        return end.value


def drifted(before, now, shift_sigma_m=0.5):
    """Landmarks of two visits, (L, 2), and their covariance: the second visit's share a shift."""
    landmarks = np.array([*before, *now], dtype=float)
    late = np.repeat([0.0] * len(before) + [1.0] * len(now), 2)
    axes = np.tile([1.0, 0.0], len(landmarks)), np.tile([0.0, 1.0], len(landmarks))
    shared = sum(np.outer(late * axis, late * axis) for axis in axes)
    return landmarks, np.eye(2 * len(landmarks)) * OWN + shared * shift_sigma_m**2


def pairings(*pairs):
    return [Pairing(now, before) for now, before in pairs]


def test_two_that_agree_on_the_drift_are_certain():
    places = [(0.0, 0.0), (2.0, 1.0)]
    landmarks, covariance = drifted(places, [(x + 0.6, y - 0.3) for x, y in places])
    found = certain_pairings(pairings((2, 0), (3, 1)), landmarks, covariance, RULE)
    assert [(pair.now, pair.before) for pair in found] == [(2, 0), (3, 1)]


def test_one_alone_is_never_believed_however_near():
    landmarks, covariance = drifted([(0.0, 0.0)], [(0.01, 0.0)])
    assert certain_pairings(pairings((1, 0)), landmarks, covariance, RULE) == []
    # With another in view that was found earlier, it is the second one.
    assert len(certain_pairings(pairings((1, 0)), landmarks, covariance, RULE, supported=1)) == 1


def test_two_that_contradict_each_other_are_not_both_taken():
    landmarks, covariance = drifted([(0.0, 0.0), (2.0, 1.0)], [(0.6, 0.0), (1.2, 1.0)])
    assert certain_pairings(pairings((2, 0), (3, 1)), landmarks, covariance, RULE) == []


def test_a_row_of_twins_is_ambiguous_until_something_else_tells():
    row = [(float(x), 0.0) for x in range(4)]
    # Two chairs of the row, half a metre off: shifted by one to either side they fit as well.
    landmarks, covariance = drifted(row, [(1.5, 0.0), (2.5, 0.0)], shift_sigma_m=0.8)
    twins = pairings(*((now, before) for now in (4, 5) for before in range(4)))
    assert certain_pairings(twins, landmarks, covariance, RULE) == []
    # A couch that stands at one end only says which.
    landmarks, covariance = drifted([*row, (1.0, 2.0)], [(1.5, 0.0), (2.5, 0.0), (1.5, 2.0)], shift_sigma_m=0.8)
    twins = pairings(*((now, before) for now in (5, 6) for before in range(4)), (7, 4))
    found = certain_pairings(twins, landmarks, covariance, RULE)
    assert [(pair.now, pair.before) for pair in found] == [(7, 4), (5, 1), (6, 2)] or {
        (pair.now, pair.before) for pair in found
    } == {(7, 4), (5, 1), (6, 2)}


def test_beyond_the_gate_nothing_is_paired():
    places = [(0.0, 0.0), (2.0, 1.0), (3.0, -1.0)]
    landmarks, covariance = drifted(places, [(x + 3.0, y) for x, y in places], shift_sigma_m=0.3)
    assert certain_pairings(pairings((3, 0), (4, 1), (5, 2)), landmarks, covariance, RULE) == []


def test_a_landmark_whose_only_candidates_are_taken_does_not_end_the_search():
    """Two tracks are in view, and only one of them can be the earlier landmark."""
    places = [(0.0, 0.0), (2.0, 1.0), (-1.0, 2.0)]
    now = [(0.6, -0.3), (1.0, -0.3), (2.6, 0.7), (-0.4, 1.7)]
    landmarks, covariance = drifted(places, now)
    found = certain_pairings(pairings((3, 0), (4, 0), (5, 1), (6, 2)), landmarks, covariance, RULE)
    assert [(pair.now, pair.before) for pair in found] == [(3, 0), (5, 1), (6, 2)]
