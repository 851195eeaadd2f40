"""A landmark's place and covariance from its observations; which landmarks a second visit may be of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.units import ended

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam import loop_hypotheses
from edgemap.geometry.slam.loop_hypotheses import LoopHypothesisRule
from edgemap.geometry.slam.object_landmarks import Landmark, observed
from edgemap.geometry.slam.pose_graph import PoseGraph

LEVEL = np.zeros(2)


def landmark_of(sightings, number=1):
    """Sightings (keyframe, place in the map, pose) of one chair."""
    landmark = Landmark(number, "chair", 0.5, 0.0)
    for keyframe, sighting in sightings:
        landmark.add(keyframe, observed(sighting, SE2(), LEVEL, 0.65))
    return landmark


def graph_of(poses, covariances):
    graph = PoseGraph()
    path = graph.trajectory
    path.poses, path.covariances = np.array([pose.vector() for pose in poses]), np.array(covariances)
    return graph


@given(st.integers(0, 2**32 - 1))
def test_the_pose_moves_a_landmark_by_its_lever(placed_, seed):
    """One sighting each from two keyframes: the covariance that a pose adds is its derivative's, by differences."""
    random = np.random.default_rng(seed)
    poses = [SE2(*row) for row in random.uniform(-3, 3, (2, 3)).tolist()]
    roots = random.normal(0.0, 0.1, (2, 3, 3))
    covariances = [root @ root.T for root in roots]
    at = random.uniform(0.5, 4.0, 2)
    one = placed_("chair", *at, 0)
    alone = landmark_of([(1, one)])
    graph_of(poses, covariances).place([alone])
    np.testing.assert_allclose(alone.position_m, poses[1].apply(at), atol=1e-9)
    landmark = landmark_of([(0, one), (1, one)])
    graph_of(poses, covariances).place([landmark])
    parts = []
    for pose, covariance in zip(poses, covariances, strict=True):
        steps = np.eye(3) * 1e-6
        moved = np.array([SE2(*(pose.vector() + step)).apply(at) - pose.apply(at) for step in steps]).T / 1e-6
        parts.append(moved @ covariance @ moved.T)
    np.testing.assert_allclose(landmark.first_m2, parts[0], atol=1e-5)
    assert landmark.variance_m2 == pytest.approx(np.mean([part.trace() / 2.0 for part in parts]), abs=1e-5)


def test_two_visits_that_join_are_one_landmark_of_all_their_sightings(placed):
    near, far = placed("chair", 2.0, 0.5, 0), placed("chair", 2.4, 0.1, 1, sigma_m=0.2)
    both = landmark_of([(0, near), (1, far), (1, near), (2, far)])
    joined = landmark_of([(0, near), (1, far)])
    joined.join(landmark_of([(1, near), (2, far)], number=2))
    assert joined.keyframes == both.keyframes
    np.testing.assert_allclose(joined.rows, both.rows)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_an_observation_moved_to_another_keyframe_is_as_if_made_from_there(placed_, x_m, y_m, yaw_rad):
    sighting, pose = placed_("chair", 2.0, 0.5, 0), SE2(x_m, y_m, yaw_rad)
    moved, there = landmark_of([(0, sighting)]), Landmark(1, "chair", 0.5, 0.0)
    there.add(3, observed(sighting, pose, LEVEL, 0.65))
    assert moved.move_to({0: (3, pose)})
    assert moved.keyframes == there.keyframes == [3]
    np.testing.assert_allclose(moved.rows, there.rows, rtol=1e-9, atol=1e-9)


RULE = LoopHypothesisRule()
OWN = 0.02**2 + 0.1**2 / 2.0  # m^2, of each object's position by itself, seen from one side


def certain_pairings(*arguments, **options):
    return ended(loop_hypotheses.certain_pairings(*arguments, **options))


def drifted(before, now, shift_sigma_m=0.5):
    """Landmarks of two visits, (L, 2), and their covariance: the second visit's share a shift."""
    landmarks = np.array([*before, *now], dtype=float)
    late = np.repeat([0.0] * len(before) + [1.0] * len(now), 2)
    axes = np.tile([1.0, 0.0], len(landmarks)), np.tile([0.0, 1.0], len(landmarks))
    shared = sum(np.outer(late * axis, late * axis) for axis in axes)
    return landmarks, np.eye(2 * len(landmarks)) * OWN + shared * shift_sigma_m**2


def test_visits_pair_where_they_agree_on_the_drift():
    places = [(0.0, 0.0), (2.0, 1.0)]
    landmarks, covariance = drifted(places, [(x + 0.6, y - 0.3) for x, y in places])
    found = certain_pairings([(2, 0), (3, 1)], landmarks, covariance, RULE)
    assert found == [(2, 0), (3, 1)]
    landmarks, covariance = drifted([(0.0, 0.0)], [(0.01, 0.0)])
    assert certain_pairings([(1, 0)], landmarks, covariance, RULE) == []
    # With another in view that was found earlier, it is the second one.
    assert len(certain_pairings([(1, 0)], landmarks, covariance, RULE, supported=1)) == 1
    landmarks, covariance = drifted([(0.0, 0.0), (2.0, 1.0)], [(0.6, 0.0), (1.2, 1.0)])
    assert certain_pairings([(2, 0), (3, 1)], landmarks, covariance, RULE) == []
    places = [(0.0, 0.0), (2.0, 1.0), (3.0, -1.0)]
    landmarks, covariance = drifted(places, [(x + 3.0, y) for x, y in places], shift_sigma_m=0.3)
    assert certain_pairings([(3, 0), (4, 1), (5, 2)], landmarks, covariance, RULE) == []


def test_a_row_of_twins_is_ambiguous_until_something_else_tells():
    row = [(float(x), 0.0) for x in range(4)]
    # Two chairs of the row, half a metre off: shifted by one to either side they fit as well.
    landmarks, covariance = drifted(row, [(1.5, 0.0), (2.5, 0.0)], shift_sigma_m=0.8)
    twins = [(now, before) for now in (4, 5) for before in range(4)]
    assert certain_pairings(twins, landmarks, covariance, RULE) == []
    # A couch that stands at one end only says which.
    landmarks, covariance = drifted([*row, (1.0, 2.0)], [(1.5, 0.0), (2.5, 0.0), (1.5, 2.0)], shift_sigma_m=0.8)
    twins = [*((now, before) for now in (5, 6) for before in range(4)), (7, 4)]
    found = certain_pairings(twins, landmarks, covariance, RULE)
    assert set(found) == {(7, 4), (5, 1), (6, 2)}


def test_a_landmark_whose_only_candidates_are_taken_does_not_end_the_search():
    """Two tracks are in view, and only one of them can be the earlier landmark."""
    places = [(0.0, 0.0), (2.0, 1.0), (-1.0, 2.0)]
    now = [(0.6, -0.3), (1.0, -0.3), (2.6, 0.7), (-0.4, 1.7)]
    landmarks, covariance = drifted(places, now)
    found = certain_pairings([(3, 0), (4, 0), (5, 1), (6, 2)], landmarks, covariance, RULE)
    assert found == [(3, 0), (5, 1), (6, 2)]
