"""The newest-frame mailbox, with a source in real time and with streams of a server on this machine."""

import queue
import time

import numpy as np
import pytest
from support.live_camera import drain
from support.mjpeg import MjpegServer
from support.rtsp import RtspServer, gradients

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import Driver, RecoveryRule
from edgemap.runtime.frames.errors import CameraError, CameraState, FrameTimeout
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.webcam import StreamDriver
from edgemap.runtime.inputs.open import open_camera


class Source(Driver):
    """A driver and its device: gives what a test puts in; an exception put in is raised."""

    name, size, rate_hz, intrinsics = "fake", (6, 4), None, None

    def __init__(self):
        self.items = queue.Queue()
        self.taken = self.asked = self.closed = 0

    def open(self):
        return self

    def grab(self):
        self.asked = self.taken  # what was taken before has been dealt with
        try:
            item = self.items.get(timeout=0.02)
        except queue.Empty:
            return None
        self.taken += 1
        if isinstance(item, Exception):
            raise item
        return item

    def put(self, stamp_s):
        self.items.put((stamp_s, np.full((4, 6, 3), round(20 * stamp_s) % 256, np.uint8)))

    def settle(self, count):
        until = time.monotonic() + 60
        while self.asked < count:
            assert time.monotonic() < until
            time.sleep(0.005)

    def close(self):
        self.closed += 1


@pytest.fixture
def source():
    return Source()


PATIENT = RecoveryRule(first_frame_limit_s=300.0, stall_limit_s=300.0)  # this process may be kept waiting


def test_a_slow_reader_gets_the_newest_and_none_twice(source):
    with LiveCamera(source, rule=PATIENT) as camera:
        for number in range(10):
            source.put(number / 20)
        source.put(9.0 / 20 + 0.05)
        source.settle(11)
        first = camera.read()
        assert (first.index, first.stamp_s) == (0, 0.5)
        source.put(1.0)
        second = camera.read()
        assert (second.index, second.stamp_s) == (1, 1.0)
    assert source.closed == 1


def test_a_read_without_a_frame_comes_back_soon(source):
    with LiveCamera(source, rule=PATIENT) as camera:
        source.put(1.0)
        camera.read()
        start = time.monotonic()
        with pytest.raises(FrameTimeout, match=r"no frame within 0\.5 s") as caught:
            camera.read()
        assert 0.4 < time.monotonic() - start < 60.0
        assert (caught.value.stamp_s or 0.0) > 1.4


def test_a_picture_of_another_size_is_refused_and_after_close_is_the_end(source):
    with LiveCamera(source, Intrinsics(640, 480, 500, 500, 320, 240)) as camera:
        source.put(1.0)
        with pytest.raises(CameraError, match="6x4, the intrinsics are for 640x480"):
            camera.read()
    camera = LiveCamera(source)
    camera.close()
    camera.close()
    assert camera.read() is None
    assert source.closed == 2  # once for each camera


@pytest.mark.parametrize("serve", [MjpegServer, lambda: RtspServer(gradients())], ids=["http", "rtsp"])
def test_a_stream_that_goes_away_comes_back(serve, monkeypatch):
    # RTSP's four attempts take it in full.
    monkeypatch.setattr("edgemap.runtime.inputs.cameras.webcam.PATIENCE_S", 0.5)
    # This process may be kept waiting by others, so only a driver that says so is a fault.
    patient = RecoveryRule(first_frame_limit_s=300.0, stall_limit_s=300.0)
    with serve() as server, LiveCamera(StreamDriver(server.url), rule=patient) as camera:
        assert camera.info.live
        assert camera.info.size == (64, 48)
        told = []
        frames = drain(camera, 20, told)
        assert told == []
        server.stop()
        time.sleep(0.5)
        server.start()
        frames += drain(camera, 20, told)
        stamps = [frame.stamp_s for frame in frames]
        assert (np.diff(stamps) > 0).all()
        assert told[0].kind.value == "failed"
        assert told[-1].kind.value == "recovered"
        assert camera.state is CameraState.RUNNING
        assert server.connections >= 2


def test_rtsp_delivers_the_pictures_that_were_served():
    pictures = gradients()
    with RtspServer(pictures) as server, open_camera(server.url) as camera:
        assert isinstance(camera, LiveCamera)
        for frame in drain(camera, 5):
            apart = [np.abs(frame.image.astype(int) - picture).mean() for picture in pictures]
            assert min(apart) < 5.0  # JPEG, twice; the next picture is 3.3 away on top
            assert sorted(apart)[1] > min(apart) + 1.0


def test_no_stream_is_one_line_without_the_password():
    with MjpegServer() as server:
        port = server.port
    with pytest.raises(
        CameraError, match=rf"^http://\*\*\*@127\.0\.0\.1:{port}/x: no stream that FFmpeg reads"
    ) as caught:
        open_camera(f"http://user:secret@127.0.0.1:{port}/x")
    assert "secret" not in str(caught.value)
