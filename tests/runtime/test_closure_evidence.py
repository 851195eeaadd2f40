"""Loop closure that cannot harm: what contradicts all observations is refused, and what is biased bends nothing."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.drives import observed, round_trip
from support.rooms import furnished

from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam import loop_closure
from edgemap.geometry.slam.loop_hypotheses import certain_pairings
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.mapper import Mapper

SIGMAS = np.array([0.002, 0.002, 0.002])  # m, m, rad, of one motion: as stated, and as it is


def odometry(way, random):
    """Motions with the errors that their covariance states."""
    motions = [Motion()]
    for before, now in pairwise(way):
        noise = SE2(*random.normal(0.0, SIGMAS))
        motions.append(Motion(before.inverse() @ now @ noise, np.diag(SIGMAS**2)))
    return motions


def low_lens(room, pose, index, random, errors, height_m=0.19):
    """What a lens near the floor sees: a lower edge that is 3 pixels off all along a visit is decimetres of range."""
    seen = []
    for row, (label, x, y) in enumerate(room):
        place = pose.inverse().apply([x, y])
        far = float(np.hypot(*place))
        if not (0.6 < far < 3.5 and abs(math.atan2(place[1], place[0])) < 0.6):
            errors.pop(row, None)
            continue
        across, sigma_m = 0.05, 3.0 * far**2 / (height_m * 500.0)
        error = errors.setdefault(row, random.normal(0.0, 0.8)) + random.normal(0.0, 0.5)
        ray = place / far
        side = np.array([-ray[1], ray[0]])
        at = place + ray * error * sigma_m + side * random.normal(0.0, across)
        covariance = np.outer(ray, ray) * sigma_m**2 + np.outer(side, side) * across**2
        seen.append(
            Sighting(label, 0.8, at, covariance, np.eye(2) * 1e-4, 0.5, 0.9, 0.5, far, len(seen), index, index / 10)
        )
    return seen


def drift_m(way, motions, sightings, closes_loops):
    """Greatest distance of the mapper's poses from the true ones; the updates."""
    mapper, updates, start, far_m = Mapper(closes_loops=closes_loops), [], way[0].inverse(), 0.0
    for index, (motion, seen) in enumerate(zip(motions, sightings, strict=True)):
        updates.append(mapper.step(observed(index, seen, motion)))
        pose, true = updates[-1].pose_map_base, start @ way[index]
        far_m = max(far_m, math.hypot(pose.x_m - true.x_m, pose.y_m - true.y_m))
    return far_m, updates


@pytest.mark.parametrize("seed", range(4))
def test_ranges_that_err_together_do_not_bend_a_trajectory_that_is_right(seed):
    """As in home 9001: odometry good to centimetres, a low lens whose ranges err by decimetres from each side. Right
    landmarks found again must not move the pose by more than odometry leaves open."""
    random, errors = np.random.default_rng(seed), dict[int, float]()
    room, way = furnished(random, 16, apart_m=0.8), round_trip(260, turns=2.4)
    motions = odometry(way, random)
    sightings = [low_lens(room, pose, index, random, errors) for index, pose in enumerate(way)]
    alone_m, _ = drift_m(way, motions, sightings, False)
    closed_m, updates = drift_m(way, motions, sightings, True)
    corrections = [update.correction for update in updates if update.correction]
    assert corrections
    assert corrections[-1].links > 3  # or this drive shows nothing
    assert closed_m < alone_m + 0.05
    sigma_m = [np.sqrt(np.trace(update.pose_covariance[:2, :2])) for update in updates]
    for index, update in enumerate(updates):
        if update.correction:  # to close a loop is to know more
            step_m = np.sqrt(np.trace(motions[index].covariance[:2, :2])) + 0.002
            assert sigma_m[index] < 1.03 * sigma_m[index - 1] + step_m


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.6, 2.0), st.integers(1, 3))
def test_false_hypotheses_never_move_the_pose_beyond_what_odometry_leaves_open(seed, apart_m, links):
    """Whatever is proposed as one object, up to three pairs at a time a metre or so apart: the pose stays within four
    standard deviations of where odometry alone has it."""
    random, real = np.random.default_rng(seed), loop_closure.certain_pairings

    def wrong(pairings, landmarks, *others):
        yield
        far_m = [float(np.linalg.norm(landmarks[pair.now] - landmarks[pair.before])) for pair in pairings]
        found = {pair.now: pair for pair, m in zip(pairings, far_m, strict=True) if abs(m - apart_m) < 0.4}
        return list({pair.before: pair for pair in found.values()}.values())[:links]

    room, way = furnished(random, 14, apart_m=0.8), round_trip(130, turns=1.6)
    motions, errors = odometry(way, random), dict[int, float]()
    sightings = [low_lens(room, pose, index, random, errors, 0.8) for index, pose in enumerate(way)]
    loop_closure.certain_pairings = wrong
    try:
        _, updates = drift_m(way, motions, sightings, True)
    finally:
        loop_closure.certain_pairings = real
    for update in updates:
        off = update.pose_odom_base.vector() - update.pose_map_base.vector()
        off[2] = math.remainder(off[2], math.tau)
        sigmas = np.sqrt(np.diagonal(update.odom_covariance)) + 1e-3
        assert (np.abs(off) < 4.0 * sigmas).all()


def test_the_search_is_the_real_one_elsewhere():
    assert loop_closure.certain_pairings is certain_pairings
