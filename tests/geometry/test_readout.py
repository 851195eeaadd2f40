"""The readout of a rolling shutter in a window of keyframes, against points that are projected row by row."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.mount import Mount, up_optical
from edgemap.geometry.odometry.keyframe_window import ImagePoints, KeyframeWindow, WindowRule
from edgemap.geometry.odometry.readout import Readout
from edgemap.geometry.odometry.resection import LensPose
from edgemap.geometry.odometry.window_factors import PoseFactors

MOUNT, FOCAL_PX, SPAN_S = Mount.from_degrees(0.8, 12.0), 250.0, 0.1
SIDES = np.array([0.64, 0.48])  # of the picture from its middle, normalised


def pose_at(stamp_s: float) -> LensPose:
    """A robot at 0.5 m/s that turns to and fro by 20 degrees."""
    yaw = 0.35 * math.sin(1.7 * stamp_s)
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return LensPose(turn @ MOUNT.rotation_base_optical(), np.array([0.5 * stamp_s, 0.0, MOUNT.height_m]))


def exposed(points, stamp_s, readout_s):
    """Normalised image points (N, 2), each of the moment at which its row is exposed, and which are in the picture."""
    image = depth = None
    for _ in range(4):
        late_s = 0.0 if image is None else np.clip(image[:, 1] / SIDES[1], -1.0, 1.0) / 2.0 * readout_s
        poses = [pose_at(stamp_s + one) for one in np.broadcast_to(late_s, len(points))]
        position = np.array([pose.position_m for pose in poses])
        local = np.einsum("ni,nij->nj", points - position, np.array([pose.rotation for pose in poses]))
        depth = local[:, 2]
        image = local[:, :2] / np.maximum(depth[:, None], 0.1)
    return image, (depth > 0.3) & (np.abs(image) < SIDES).all(axis=1)


def driven(readout_s, pictures=80):
    """A window after a drive through a room, with the points' motion as its tracks show it."""
    rng, count = np.random.default_rng(0), 130
    floor = np.column_stack([rng.uniform(0.5, 9.0, count), rng.uniform(-3.0, 3.0, count), np.zeros(count)])
    wall = np.column_stack([rng.uniform(0.5, 9.0, count), rng.choice([-3.0, 3.0], count), rng.uniform(0.0, 2.5, count)])
    points, on_floor = np.concatenate([floor, wall]), np.repeat([0.9, 0.1], count)
    window, before, seen_before = KeyframeWindow(WindowRule(), FOCAL_PX, MOUNT, 12.0), None, np.zeros(2 * count, bool)
    for index in range(pictures):
        image, seen = exposed(points, index * SPAN_S, readout_s)
        image = image + rng.normal(0.0, 0.05 / FOCAL_PX, image.shape)
        both = seen & seen_before
        speed = np.where(both[:, None], image - (image if before is None else before), 0.0) / SPAN_S
        ids, start = np.flatnonzero(seen), window.poses[-1] if window.poses else pose_at(0.0)
        height = MOUNT.height_m
        up = up_optical(MOUNT.pitch_rad, 0.0)
        factors = PoseFactors(up, math.radians(0.3), height, 0.004 * height, 0.002 * height, np.eye(3))
        late = speed * image[:, 1:] / SIDES[1] / 2.0
        tracks = ImagePoints(ids, image[seen], late[seen], on_floor[seen], np.full(len(ids), np.nan))
        if before is not None:
            first = speed * before[:, 1:] / SIDES[1] / 2.0
            window.begin_again(np.flatnonzero(both), before[both], first[both])
            start, _ = window.resected(start, tracks, factors)
            window.average_late(np.flatnonzero(both), first[both])
        window.step(start, factors, tracks, 8.0, carried=False)
        before, seen_before = image, seen
    return window


@pytest.mark.parametrize("readout_s", [0.0, 0.03, -0.02])
def test_the_readout_is_found_and_does_not_lengthen_the_way(readout_s):
    window = driven(readout_s)
    assert window.readout.time_s == pytest.approx(readout_s, abs=0.003)
    moved, true = window.poses[-2].inverse() @ window.poses[-1], pose_at(7.8).inverse() @ pose_at(7.9)
    np.testing.assert_allclose(moved.position_m, true.position_m, atol=0.004)
    away_m = float(np.linalg.norm(window.poses[-1].position_m - pose_at(7.9).position_m))
    assert away_m < 0.04  # of 3.95 m


@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(1e3, 1e6), st.floats(1e3, 1e7))
def test_a_share_of_a_windows_information_counts(prior_s, measured_s, prior, added):
    posterior_s = (prior * prior_s + added * measured_s) / (prior + added)
    whole = Readout(prior_s, prior).updated(posterior_s, added, 1.0)
    assert whole.information == pytest.approx(prior + added)
    assert whole.time_s == pytest.approx(posterior_s, abs=1e-9)
    half = Readout(prior_s, prior).updated(posterior_s, added, 0.5)
    assert half.time_s == pytest.approx((prior * prior_s + 0.5 * added * measured_s) / (prior + 0.5 * added), abs=1e-9)
    assert Readout(prior_s, prior).updated(posterior_s, 0.0, 1.0) == Readout(prior_s, prior)
