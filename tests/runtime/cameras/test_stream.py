"""Network cameras that leave the network and come back, in real time."""

import time

import numpy as np
import pytest
from support.live_camera import drain
from support.mjpeg import MjpegServer
from support.rtsp import RtspServer, gradients

from edgemap.runtime.frames.camera import RecoveryRule
from edgemap.runtime.frames.errors import CameraError, CameraState
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.webcam import StreamDriver
from edgemap.runtime.inputs.open import open_camera


@pytest.mark.parametrize("serve", [MjpegServer, lambda: RtspServer(gradients())], ids=["http", "rtsp"])
def test_a_stream_that_goes_away_comes_back(serve, monkeypatch):
    monkeypatch.setattr(
        "edgemap.runtime.inputs.cameras.webcam.READ_LIMIT_MS", 500
    )  # RTSP's four attempts take it in full
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
