"""A landmark's place and covariance from its observations, against sums and derivatives by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeTrajectory
from edgemap.geometry.slam.object_landmarks import Landmark, observed, place

LEVEL = np.zeros(2)


def landmark_of(sightings, number=1):
    """Sightings (keyframe, place in the map, pose) of one chair."""
    landmark = Landmark(number, "chair", 0.5, 0.0)
    for keyframe, sighting in sightings:
        landmark.add(keyframe, observed(sighting, SE2(), LEVEL, 0.65))
    return landmark


def trajectory_of(poses, covariances):
    trajectory = KeyframeTrajectory()
    trajectory.poses, trajectory.covariances = list(poses), list(covariances)
    trajectory.stamps_s = [float(row) for row in range(len(poses))]
    return trajectory


@given(st.integers(0, 2**32 - 1))
def test_the_pose_moves_a_landmark_by_its_lever(placed_, seed):
    """One sighting each from two keyframes: the covariance that a pose adds is its derivative's, by differences."""
    random = np.random.default_rng(seed)
    poses = [SE2(*row) for row in random.uniform(-3, 3, (2, 3)).tolist()]
    roots = random.normal(0.0, 0.1, (2, 3, 3))
    covariances = [root @ root.T for root in roots]
    at = random.uniform(0.5, 4.0, 2)
    one = placed_("chair", *at, 0).sighting.placed(SE2(), np.zeros((3, 3)))
    alone = landmark_of([(1, one)])
    place([alone], trajectory_of(poses, covariances), LEVEL, 0.15)
    np.testing.assert_allclose(alone.position_m, poses[1].apply(at), atol=1e-9)
    landmark = landmark_of([(0, one), (1, one)])
    place([landmark], trajectory_of(poses, covariances), LEVEL, 0.15)
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
