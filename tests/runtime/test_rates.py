"""Evidence is time in view, not pictures: 30, 10, 5 and 3.3 Hz make the same map."""

from dataclasses import replace

import numpy as np
import pytest
from support.drives import exact, observed, round_trip, sighted
from support.rooms import furnished

from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.mapper import Mapper

ROOM = furnished(np.random.default_rng(5), 12, apart_m=1.0)
WAY = round_trip(3 * 120, turns=1.1)  # 12 s at 30 Hz


def mapped(every, room=ROOM, way=WAY):
    """The map of a drive of which every so many pictures of 30 Hz are taken."""
    mapper, random = Mapper(), np.random.default_rng(0)
    poses = way[::every]
    for index, (pose, motion) in enumerate(zip(poses, exact(poses), strict=True)):
        stamp_s = index * every / 30.0
        sightings = [replace(seen, stamp_s=stamp_s) for seen in sighted(room, pose, index, random)]
        known = Motion(motion.motion, np.eye(3) * 1e-8)
        mapper.step(replace(observed(index, sightings, known), stamp_s=stamp_s))
    return mapper.objects()


def off_m(a, b):
    """Distance of two objects."""
    return float(np.linalg.norm(a.position_m - b.position_m))


@pytest.mark.parametrize("every", [1, 6, 9])
def test_the_map_does_not_depend_on_the_rate(every):
    usual, other = mapped(3), mapped(every)
    assert len(usual) >= 8
    assert abs(len(other) - len(usual)) <= 1  # one may be in view for just long enough
    for item in usual if len(usual) <= len(other) else other:
        there = other if len(usual) <= len(other) else usual
        near = min((seen for seen in there if seen.label == item.label), key=lambda seen: off_m(seen, item))
        assert off_m(near, item) < 0.15
        assert near.confidence == pytest.approx(item.confidence, abs=0.08)


@pytest.mark.parametrize(("rate_hz", "pictures"), [(30, 6), (10, 2), (60, 12)])
def test_a_glimpse_is_no_object_however_many_pictures_show_it(rate_hz, pictures):
    """A fifth of a second in view is on no map, six tenths are."""
    mapper = Mapper()

    def see(count, start):
        for index in range(start, start + count):
            stamp_s = index / rate_hz
            (seen,) = sighted([("chair", 2.0, 0.1)], SE2(), index, np.random.default_rng(index))
            seen = replace(seen, stamp_s=stamp_s)
            motion = Motion(SE2(), np.zeros((3, 3)))
            mapper.step(replace(observed(index, [seen], motion), stamp_s=stamp_s))

    see(pictures, 0)
    assert mapper.objects() == []
    see(2 * pictures, pictures)
    assert len(mapper.objects()) == 1
