"""Poses among points of known depth, against points that are projected by hand."""

import math
from dataclasses import replace

import numpy as np

from edgemap.geometry.odometry.resection import DepthLandmarks, LensPose, resect

SIGMA = 0.001


def turned(yaw_rad, pitch_rad=0.0):
    """Optical axes after a turn to the right and then downwards."""
    cy, sy, cp, sp = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])


def scene(seed, true, depth_noise=0.0):
    """Landmarks seen from the origin, with errors of their depth, and where a lens at `true` sees them."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, 200), rng.uniform(-0.35, 0.35, 200), np.ones(200)])
    depth_m = rng.uniform(1.0, 5.0, 200)
    local = (rays * depth_m[:, None] - true.position_m) @ true.rotation
    seen = local[:, :2] / local[:, 2:] + rng.normal(0.0, SIGMA, (200, 2))
    sigma_m = np.full(200, max(depth_noise, 1e-6))
    measured_m = depth_m + rng.normal(0.0, 1.0, 200) * sigma_m
    return DepthLandmarks(rays * measured_m[:, None], rays, sigma_m), seen


def test_a_pose_is_found_among_a_third_of_wrong_matches():
    true = LensPose(turned(0.1, 0.05), np.array([0.1, -0.02, 0.15]))
    landmarks, seen = scene(0, true)
    seen[::3] += np.random.default_rng(1).uniform(-0.3, 0.3, seen[::3].shape)
    pose, weights = resect(landmarks, seen, LensPose(turned(0.098, 0.051), np.array([0.09, -0.02, 0.14])), SIGMA)
    np.testing.assert_allclose(pose.position_m, true.position_m, atol=2e-3)
    np.testing.assert_allclose(pose.rotation, true.rotation, atol=5e-4)
    assert weights[::3].mean() < 0.05
    assert weights[1::3].mean() > 0.6


def test_depths_that_are_known_to_err_move_a_pose_less_and_put_no_point_aside():
    true, off_m, kept = LensPose(turned(0.08), np.array([0.1, 0.0, 0.2])), [], []
    for seed in range(20):
        landmarks, seen = scene(seed, true, depth_noise=0.1)
        for stated in (landmarks, replace(landmarks, sigma_m=np.full(200, 1e-6))):
            pose, weights = resect(stated, seen, true, SIGMA)
            off_m.append(np.linalg.norm(pose.position_m - true.position_m))
            kept.append((weights > 0.0).mean())
    assert np.mean(off_m[::2]) < 0.8 * np.mean(off_m[1::2])
    assert np.mean(kept[::2]) > 0.99 > 0.9 > np.mean(kept[1::2])


def test_what_is_measured_of_a_pose_outweighs_points_that_agree_on_another():
    """More points agree on a lens 0.4 m lower than on the true one; its height is known better than they tell."""
    true, low = LensPose(np.eye(3), np.array([0.1, 0.0, 0.2])), LensPose(np.eye(3), np.array([0.0, 0.4, 0.0]))
    landmarks, seen = scene(0, true)
    seen[::3], seen[1::3] = scene(0, low)[1][::3], scene(0, low)[1][1::3]
    (lower, _), (held, weights) = (resect(landmarks, seen, low, SIGMA, prior) for prior in (None, at_height(0.0, 1e-4)))
    np.testing.assert_allclose(lower.position_m, low.position_m, atol=2e-3)
    assert abs(held.position_m[1]) < 0.03
    assert weights[1::3].mean() < 0.05


def at_height(y_m, sigma_m):
    """The y coordinate of a pose, measured."""
    row = np.array([[0.0, 0.0, 0.0, 0.0, 1.0 / sigma_m, 0.0]])
    return lambda pose: (row, np.array([(y_m - pose.position_m[1]) / sigma_m]))


def test_poses_compose_and_invert():
    a, b = LensPose(turned(0.3, -0.1), np.array([1.0, 2.0, 3.0])), LensPose(turned(-0.2), np.array([0.1, 0.0, 0.4]))
    point = np.array([0.5, -0.3, 2.0])
    inner = b.rotation @ point + b.position_m
    np.testing.assert_allclose((a @ b).rotation @ point + (a @ b).position_m, a.rotation @ inner + a.position_m)
    none = a @ a.inverse()
    np.testing.assert_allclose(np.column_stack([none.rotation, none.position_m]), np.eye(3, 4), atol=1e-12)
