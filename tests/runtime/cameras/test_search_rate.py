"""Cameras around cameras: which pictures are searched follows from their stamps; quarter turns."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.made_camera import MadeCamera
from support.noise import noise
from support.recordings import FACTS, drain, record

from edgemap.cli.camera_options import open_described
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.opening import open_session
from edgemap.runtime.frames.camera import CameraOptions, check_size
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.program_camera import FramesCamera
from edgemap.runtime.inputs.cameras.wrappers import RotatedCamera, SearchRate
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


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_two_turns_that_add_up_to_a_whole_one_change_nothing(degrees):
    with open_described("demo", None) as camera:
        whole = RotatedCamera(RotatedCamera(camera, degrees), 360 - degrees)
        assert whole.info.size == camera.info.size
        assert whole.info.intrinsics == camera.info.intrinsics
        turned, plain = RotatedCamera(camera, degrees).read(), whole.read()
    assert turned.image.shape[:2] == ((480, 640) if degrees == 180 else (640, 480))
    with open_described("demo", None) as again:
        first, second = islice(iter(again.read, None), 2)
    np.testing.assert_array_equal(turned.image, np.rot90(first.image, -degrees // 90))
    np.testing.assert_array_equal(plain.image, second.image)


def test_what_is_stated_is_of_the_upright_pictures():
    with open_described("demo", None) as camera:
        lens = camera.info.intrinsics
    upright = lens.rotated(90)
    with open_described("demo", None, CameraOptions(intrinsics=upright, rotate=90)) as camera:
        assert camera.info.intrinsics == upright
        assert camera.info.size == (480, 640)
        assert camera.info.mount is not None


def test_gravity_of_a_camera_on_its_side_points_up_in_upright_pictures():
    """Its picture's right side is up, so turning it counterclockwise (270 clockwise) makes it upright: up is -y."""
    camera = FramesCamera([np.zeros((48, 64, 3), np.uint8)], (60.0, 60.0, 31.5, 23.5), (0.6, 0.0))
    samples = ImuSamples(np.zeros(1), np.zeros((1, 3)), np.array([[9.81, 0.0, 0.0]]))
    camera.update_info(imu=samples)
    frame = RotatedCamera(camera, 270).read()
    np.testing.assert_allclose(frame.imu.accel_m_s2, [[0.0, -9.81, 0.0]], atol=1e-12)


def test_pictures_without_room_for_anything_are_one_line():
    camera = FramesCamera([np.zeros((12, 64, 3), np.uint8)], (60.0, 60.0, 31.5, 5.5), (0.6, 0.0))
    with pytest.raises(CameraError, match="pictures of 64x12 px, both sides must have 32 px or more"):
        check_size(camera)
