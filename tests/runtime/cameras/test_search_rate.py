"""`--rate`: which pictures are searched follows from their stamps alone."""

from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.made_camera import MadeCamera
from support.noise import noise
from support.recordings import FACTS, drain, record

from edgemap.opening import open_session
from edgemap.runtime.inputs.cameras.wrappers import SearchRate
from edgemap.runtime.inputs.open import open_camera


class Stamped(MadeCamera):
    """Pictures at these stamps."""

    def __init__(self, stamps_s):
        super().__init__(len(stamps_s), lambda index: noise(index, (48, 64, 3)), size=(64, 48))
        self._stamp_of = stamps_s.__getitem__


def marks(stamps_s, rate_hz):
    return [frame.search for frame in drain(SearchRate(Stamped(stamps_s), rate_hz))]


def test_at_three_of_ten_hertz_the_nearest_pictures_are_searched():
    searched = [index for index, mark in enumerate(marks([i / 10 for i in range(21)], 3.0)) if mark]
    assert searched == [0, 3, 7, 10, 13, 17, 20]


@given(st.integers(1, 60), st.floats(0.5, 60.0), st.lists(st.floats(-0.2, 0.2), min_size=40, max_size=40))
def test_any_rate_is_kept_whatever_the_jitter_and_a_faster_one_searches_all(camera_hz, rate_hz, jitter):
    stamps_s = [(index + part) / camera_hz for index, part in enumerate(jitter)]
    searched = marks(stamps_s, rate_hz)
    assert searched[0]
    if rate_hz >= 2.0 * camera_hz:
        assert all(searched)
    wanted = min(40.0, 39.0 / camera_hz * rate_hz)
    assert sum(searched) <= wanted + 3.0
    if rate_hz <= 0.5 * camera_hz:
        assert sum(searched) >= wanted - 2.0


@pytest.mark.parametrize("later_s", [-50.0, 50.0])
def test_a_clock_that_is_set_and_a_gap_leave_nothing_unsearched(later_s):
    stamps_s = [index / 10 for index in range(20)]
    searched = marks(stamps_s + [100.0 + later_s + one for one in stamps_s], 5.0)
    assert 9 <= sum(searched[20:]) <= 12


def test_a_recording_keeps_which_pictures_were_searched(tmp_path):
    frames = drain(SearchRate(Stamped([index / 10 for index in range(10)]), 3.0))
    path = record(tmp_path / "a.mcap", FACTS, frames, lossless=True)
    with open_camera(str(path)) as tape:
        assert [frame.search for frame in drain(tape)] == [frame.search for frame in frames]


def test_the_demo_keeps_its_objects_at_three_hertz():
    session = open_session(SearchRate(open_camera("demo"), 3.0))
    searched = [step.observed.searched for step in islice(session, 200)]
    assert 0.9 * 60 <= sum(searched) <= 61  # 20 s; a blind picture is not searched
    assert len(session.map) >= 5, len(session.map)
