"""The newest-frame mailbox, with a source in real time and with streams of a server on this machine."""

import time

import numpy as np
import pytest
from support.live_camera import ScriptedDriver, drain, scripted
from support.mjpeg import MjpegServer
from support.rtsp import RtspServer, gradients
from support.waiting import wait_for

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import RecoveryRule
from edgemap.runtime.frames.errors import CameraError, CameraState
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.webcam import StreamDriver
from edgemap.runtime.inputs.open import open_camera

# This process may be kept waiting by others, so only a driver that says so is a fault.
PATIENT = RecoveryRule(first_frame_limit_s=300.0, stall_limit_s=300.0)


class RealClock:
    """The machine's, as `ScriptedDriver` asks for it."""

    __call__, wait = staticmethod(time.monotonic), staticmethod(time.sleep)


def test_a_slow_reader_gets_the_newest_and_none_twice():
    driver = ScriptedDriver(RealClock(), rate_hz=100.0)
    with LiveCamera(driver, rule=PATIENT) as camera:
        for index in (0, 2, 4):
            until = driver.grabs + 5
            wait_for(lambda until=until: driver.grabs >= until)
            newest, later = camera.read(), camera.read()
            assert (newest.index, later.index) == (index, index + 1)
            assert until - 2 <= newest.image[0, 0, 2] < later.image[0, 0, 2]  # each grab's picture has its number
    wait_for(lambda: driver.calls == ["open", "close"])


def test_a_picture_of_another_size_is_refused_and_after_close_is_the_end():
    camera, driver, clock = scripted()
    other = LiveCamera(driver, Intrinsics(640, 480, 500, 500, 320, 240), None, None, clock, clock.wait)
    with pytest.raises(CameraError, match="6x4, the intrinsics are for 640x480"):
        other.read()
    camera.close()
    camera.close()
    assert camera.read() is None


@pytest.mark.parametrize("serve", [MjpegServer, lambda: RtspServer(gradients())], ids=["http", "rtsp"])
def test_a_stream_that_goes_away_comes_back(serve, monkeypatch):
    # RTSP's four attempts take it in full.
    monkeypatch.setattr("edgemap.runtime.inputs.cameras.webcam.PATIENCE_S", 0.5)
    with serve() as server, LiveCamera(StreamDriver(server.url), rule=PATIENT) as camera:
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
