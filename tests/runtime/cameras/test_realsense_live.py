"""The live RealSense driver on librealsense's playback: what a recording can prove of it. Hardware resets it cannot."""

import threading

import numpy as np
import pytest
from support.live_camera import drain
from support.realsense_playback import Playback

pytest.importorskip("pyrealsense2")

from edgemap.runtime.frames.camera import RecoveryRule
from edgemap.runtime.inputs.cameras.live import LiveCamera


def test_a_stream_that_ends_is_late_and_then_opened_again(realsense_recording):
    path, pictures, _ = realsense_recording
    driver, told = Playback(path), []
    with LiveCamera(driver, rule=RecoveryRule(stall_limit_s=0.4)) as camera:
        assert (camera.info.live, camera.info.size, camera.info.rate_hz) == (True, (640, 480), 30.0)
        assert camera.info.intrinsics.fx == 615.2
        driver.broken = 1
        frames = drain(camera, len(pictures) + 5, told)
    kinds = [fault.kind.value for fault in told]  # on a busy machine it is late before that, too
    ended = kinds.index("closed")
    assert "late" in kinds[:ended]
    assert "recovered" in kinds[ended:]
    stamps = np.diff([frame.stamp_s for frame in frames])
    assert (stamps > 0).all()  # the second playback's stamps begin again, the stream's do not
    assert any((frames[0].image[..., ::-1] == picture).all() for picture in pictures)


def test_librealsenses_device_change_callback_says_what_came(realsense_recording):
    # That something went, librealsense does not say of recordings.
    path, _, _ = realsense_recording
    driver, told, changed = Playback(path), [], threading.Event()

    def tell(present):
        told.append(present)
        changed.set()

    driver.watch(tell)
    driver.plug_in()
    assert changed.wait(5.0)
    assert told == [True]


def test_a_reset_without_a_device_does_nothing(realsense_recording):
    assert not Playback(realsense_recording[0]).reset()
