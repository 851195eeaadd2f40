"""NaN, infinity and covariances that are none never reach pose or map, whatever a source says; nothing drifts."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.drives import observed

from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.mapper import Mapper

WILD = st.one_of(
    st.floats(-3.0, 3.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, 1e9, -1e9, 1e-320])
)
TAME = st.floats(-0.3, 0.3)
SPREAD = st.one_of(st.floats(1e-4, 0.5), st.sampled_from([0.0, -1.0, math.nan, math.inf, 1e300]))


@st.composite
def motions(draw):
    values = draw(st.one_of(st.tuples(TAME, TAME, TAME), st.tuples(WILD, WILD, WILD)))
    covariance = np.diag([draw(SPREAD), draw(SPREAD), draw(SPREAD)])
    covariance[0, 1] = draw(st.sampled_from([0.0, 0.0, 0.01, 5.0, math.nan]))
    covariance[1, 0] = draw(st.sampled_from([covariance[0, 1], 0.0]))
    with np.errstate(invalid="ignore"):
        try:
            return Motion(SE2(*values), covariance)
        except ValueError:  # of an infinite angle
            return Motion(SE2(values[0], values[1], 0.0), covariance)


@st.composite
def sightings(draw):
    place = np.array([draw(st.one_of(st.floats(0.5, 4.0), WILD)), draw(st.one_of(st.floats(-2.0, 2.0), WILD))])
    own, shared = np.diag([draw(SPREAD), draw(SPREAD)]), np.diag([draw(SPREAD), draw(SPREAD)])
    size = draw(st.one_of(st.just(0.5), WILD))
    label = draw(st.sampled_from(["chair", "couch"]))
    return Sighting(label, 0.9, place, own, shared, size, 0.9, 0.5, 1.0, 0, 0)


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(motions(), st.lists(sightings(), max_size=4)), min_size=1, max_size=8))
def test_whatever_comes_pose_and_map_stay_finite_and_covariances_positive(frames):
    mapper = Mapper(closes_loops=True)
    for index, (motion, seen) in enumerate(frames):
        update = mapper.step(observed(index, seen, motion))
        assert np.isfinite(update.pose_map_base.vector()).all()
        assert np.isfinite(update.pose_covariance).all()
        scale = max(1e-12, float(np.abs(update.pose_covariance).max()))
        assert np.linalg.eigvalsh((update.pose_covariance + update.pose_covariance.T) / 2)[0] >= -1e-6 * scale
    for item in mapper.objects():
        assert np.isfinite(item.position_m).all()
        assert np.isfinite([item.width_m, item.height_m, item.confidence, item.first_seen_s, item.last_seen_s]).all()
        assert np.linalg.eigvalsh(item.covariance_m2)[0] > -1e-9


def test_a_motion_that_cannot_be_is_a_fault_and_the_pose_stays():
    mapper = Mapper()
    mapper.step(observed(0, [], Motion()))
    before = mapper.pose_map_base
    for motion in (SE2(math.nan, 0.0, 0.0), SE2(0.0, 1e9, 0.0)):
        assert mapper.step(observed(1, [], Motion(motion, np.eye(3)))).pose_map_base == before
    bent = np.diag([0.1, -0.1, 0.1])
    assert mapper.step(observed(2, [], Motion(SE2(1.0, 0.0, 0.0), bent))).pose_map_base == before
    assert mapper.step_blind(Motion(SE2(math.inf, 0.0, 0.0), np.eye(3)))[0] == before


def test_a_hundred_thousand_steps_do_not_drift():
    """Accumulated in doubles, 100,000 steps there and back end within a micrometre and a microradian."""
    pose, there = SE2(), SE2(0.013, -0.002, 0.37)
    for _ in range(50_000):
        pose = pose @ there
    for _ in range(50_000):
        pose = pose @ there.inverse()
    assert pose.vector() == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert -math.pi < pose.yaw_rad <= math.pi
