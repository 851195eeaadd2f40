"""The newest-frame mailbox with a source that a test drives."""

# pyright: reportOptionalMemberAccess=false

import queue
import time

import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.cameras.latest import LatestFrameCamera
from edgemap.runtime.errors import CameraError


class Source:
    """Gives what a test puts in; an exception put in is raised."""

    def __init__(self):
        self.items = queue.Queue()
        self.taken = 0
        self.closed = 0

    def grab(self):
        try:
            item = self.items.get(timeout=0.02)
        except queue.Empty:
            return None
        self.taken += 1
        if isinstance(item, Exception):
            raise item
        return item

    def put(self, stamp_s):
        self.items.put((stamp_s, np.full((4, 6, 3), int(stamp_s) % 256, np.uint8)))

    def settle(self, count):
        until = time.monotonic() + 5
        while self.taken < count and time.monotonic() < until:
            time.sleep(0.005)
        time.sleep(0.05)

    def close(self):
        self.closed += 1


@pytest.fixture
def source():
    return Source()


def camera_of(source, **options):
    return LatestFrameCamera("fake", source.grab, source.close, (6, 4), **options)


def test_a_slow_reader_gets_the_newest_and_none_twice(source):
    with camera_of(source) as camera:
        for stamp in range(10):
            source.put(float(stamp))
        source.settle(10)
        first = camera.read()
        assert (first.index, first.stamp_s, first.image[0, 0, 0]) == (0, 9.0, 9)
        source.put(10.0)
        second = camera.read()
        assert (second.index, second.stamp_s) == (1, 10.0)
    assert source.closed == 1


def test_a_dead_device_raises_and_keeps_raising(source):
    with camera_of(source) as camera:
        source.put(1.0)
        assert camera.read().stamp_s == 1.0
        source.items.put(CameraError("fake: unplugged"))
        for _ in range(3):
            with pytest.raises(CameraError, match="unplugged"):
                camera.read()
    assert source.closed == 1


def test_a_silent_device_raises_within_its_limit(source):
    with camera_of(source) as camera:
        source.put(1.0)
        camera.read()
        start = time.monotonic()
        with pytest.raises(CameraError, match=r"no frame for 1\.\d s \(limit 1\.0 s\)"):
            camera.read()
        assert 0.8 < time.monotonic() - start < 1.6


def test_the_first_frame_may_take_longer_but_not_for_ever(source):
    with camera_of(source, first_frame_limit_s=0.2) as camera, pytest.raises(CameraError, match=r"limit 0\.2 s"):
        camera.read()


def test_the_stall_limit_follows_the_frame_rate(source):
    with camera_of(source) as camera:
        for stamp in range(5):
            source.put(float(stamp))
            time.sleep(0.3)
        assert camera.stall_limit_s == pytest.approx(3.0, rel=0.2)


def test_a_clock_that_jumps_back_is_an_error_and_a_small_step_is_not(source):
    with camera_of(source) as camera:
        source.put(100.0)
        camera.read()
        source.put(99.99)
        assert camera.read().stamp_s == pytest.approx(100.0, abs=1e-3)
        source.put(3.0)
        with pytest.raises(CameraError, match="clock went back"):
            camera.read()


def test_a_picture_of_another_size_than_the_lens_is_refused(source):
    with camera_of(source, intrinsics=Intrinsics(640, 480, 500, 500, 320, 240)) as camera:
        source.put(1.0)
        with pytest.raises(CameraError, match="6x4, the intrinsics are for 640x480"):
            camera.read()


def test_reading_after_close_is_the_end(source):
    camera = camera_of(source)
    camera.close()
    camera.close()
    assert camera.read() is None
