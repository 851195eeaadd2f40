"""A live camera: the ladder from a late frame to a lost camera, on a clock that the test owns; the newest-frame
mailbox, in real time and with streams of a server on this machine."""

import time

import cv2
import numpy as np
import pytest
from support.faults import kinds
from support.live_camera import ScriptedDriver, drain, picture, scripted
from support.mjpeg import MjpegServer
from support.rtsp import RtspServer, gradients
from support.waiting import wait_for

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import CameraOptions, RecoveryRule
from edgemap.runtime.frames.errors import CameraError, CameraFault, CameraLostError, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.webcam import StreamDriver
from edgemap.runtime.inputs.cameras.wrappers import CameraAround
from edgemap.runtime.inputs.open import open_camera


class Unprintable(Exception):
    def __str__(self):
        raise ValueError("no text")


def increasing(frames):
    stamps = [frame.stamp_s for frame in frames]
    assert np.isfinite(stamps).all()
    assert (np.diff(stamps) > 0).all()
    return np.diff(stamps)


def test_a_three_second_stall_is_told_and_recovers():
    camera, driver, _ = scripted(dict.fromkeys(range(20, 50)))  # 3 s at 10 Hz
    faults = []
    frames = drain(camera, 40, faults)
    assert kinds(faults) == ["late", "recovered"]
    assert "no frame for 1.0 s (limit 1.0 s)" in str(faults[0])
    assert increasing(frames).max() == pytest.approx(3.1, abs=0.3)  # opened again meanwhile: the host's clock counts
    assert camera.state is CameraState.RUNNING
    assert driver.calls == ["open", "close", "open"]


def test_the_stall_limit_follows_the_frame_rate():
    camera, driver, _ = scripted({}, rate_hz=2.0)
    drain(camera, 30)
    for silent, expected in ((8, []), (12, ["late", "recovered"])):  # 4 s and 6 s
        driver.script = {driver.grabs + i: None for i in range(silent)}
        faults = []
        drain(camera, 3, faults)
        assert kinds(faults) == expected
    assert "(limit 5.0 s)" in str(faults[0])


def test_a_process_that_stood_still_opens_nothing_again():
    camera, driver, clock = scripted()
    drain(camera, 20)
    clock.now_s += 2.0  # SIGSTOP: the host's clock goes on, the grab under way finds nothing
    driver.script = {driver.grabs: None}
    faults = []
    drain(camera, 5, faults)
    assert kinds(faults) == ["late", "recovered"]
    assert driver.calls == ["open"]


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError("USB"), OSError(19, "No such device"), MemoryError(), cv2.error("decode"), ValueError("?"),
        SystemExit(3), KeyboardInterrupt(), Unprintable(),
    ],
)  # fmt: skip
def test_whatever_a_grab_raises_is_a_fault(error):
    camera, driver, _ = scripted({5: error})
    faults = []
    frames = drain(camera, 20, faults)
    assert kinds(faults) == ["failed", "recovered"]
    assert type(error).__name__ in str(faults[0])
    assert "\n" not in str(faults[0])
    assert driver.calls == ["open"]  # retried, not opened again
    increasing(frames)


def test_a_grab_that_takes_a_stalls_time_to_fail_is_not_tried_again():
    """As those of RTSP do, whose reads end by their time limit: four of them would be eight seconds."""
    camera, driver, clock = scripted()
    drain(camera, 20)
    grab = driver.grab

    def slow():
        driver.grab = grab
        clock.wait(2.0)
        raise CameraError("gives no picture")

    driver.grab = slow
    faults = []
    frames = drain(camera, 5, faults)
    assert kinds(faults) == ["failed", "recovered"]
    assert driver.calls == ["open", "close", "open"]
    assert increasing(frames)[0] < 0.2
    assert "after 2." in str(faults[-1])


def test_a_device_that_stays_dead_is_opened_then_reset_with_growing_waits():
    errors = {number: RuntimeError("dead") for number in range(10, 14)}
    camera, driver, clock = scripted(errors, closed=4)
    faults, before = [], clock()
    drain(camera, 20, faults)
    assert driver.calls == ["open", "close", "open", "reset", "open", "open", "reset", "open", "open"]
    assert kinds(faults) == ["failed", *["closed"] * 4, "recovered"]
    assert clock() - before == pytest.approx(2.0 + 0.4 + 0.15 + 0.5 + 1.0 + 2.0 + 4.0, abs=0.5)


def test_an_unplugged_device_is_noticed_at_once_and_one_plugged_in_is_opened_at_once():
    camera, driver, clock = scripted(closed=6)
    drain(camera, 20)
    driver.changed(False)
    faults, before = [], clock()
    with pytest.raises(CameraFault) as caught:
        camera.read()
    assert caught.value.kind is FaultKind.REMOVED
    while driver.closed > 1:
        with pytest.raises((CameraFault, FrameTimeout)):
            camera.read()
    driver.closed, waited = 0, clock()
    driver.changed(True)
    drain(camera, 1, faults)
    assert clock() - waited < 0.5  # and not the 16 s of its back-off
    assert waited - before > 7.0


def test_a_camera_that_never_comes_back_is_lost_after_its_budget():
    rule = RecoveryRule(restarts=4)
    camera, driver, _ = scripted({n: RuntimeError("dead") for n in range(10, 20)}, rule)
    driver.closed = 1000
    drain(camera, 10)
    faults = []
    with pytest.raises(CameraLostError, match=r"lost, no frame for \d+ s and 4 restarts are spent") as caught:
        drain(camera, 1, faults)
    assert kinds(faults) == ["failed", *["closed"] * 4]
    assert camera.state is CameraState.LOST
    assert caught.value.exit_code == 3
    with pytest.raises(CameraLostError):
        camera.read()


def test_the_budget_grows_again_while_frames_come():
    rule = RecoveryRule(restarts=3)
    errors = {start + n: RuntimeError("dead") for start in range(0, 9000, 900) for n in range(4)}
    camera, driver, _ = scripted(errors, rule)
    assert len(drain(camera, 8700)) == 8700
    assert driver.calls.count("open") == 11


def test_away_the_stream_time_goes_on():
    camera, _, _ = scripted(dict.fromkeys(range(10, 30)))
    last = drain(camera, 10)[-1].stamp_s
    with pytest.raises(FrameTimeout, match=r"no frame within 0\.5 s") as caught:
        camera.read()
    assert caught.value.stamp_s == pytest.approx(last + 0.5, abs=0.11)
    assert caught.value.state is CameraState.RUNNING
    with pytest.raises(CameraFault, match="no frame for"):
        camera.read()
    with pytest.raises(FrameTimeout) as caught:
        camera.read()
    assert caught.value.state is CameraState.DEGRADED


@pytest.mark.parametrize(
    ("script", "expected", "delivered"),
    [
        ({5: (100.55, picture(4)), 6: (100.55, picture(4))}, [], 1),
        ({5: (float("nan"), picture(5))}, ["stamp"], 1),
        ({5: (float("inf"), picture(5))}, ["stamp"], 1),
        ({5: (1e308, picture(5))}, ["stamp"], 1),
        ({5: (3.0, picture(5))}, ["clock"], 1),
        ({5: (5000.0, picture(5))}, ["clock"], 1),
        ({5: (100.6, picture(5, (8, 4)))}, ["size"], 0),
        ({5: (100.6, picture(5).astype(np.float32))}, ["format"], 0),
        ({5: (100.6, np.zeros((4, 6, 4), np.uint8))}, ["format"], 0),
        ({5: (100.6, picture(5)[..., 1])}, ["format"], 0),
    ],
)
def test_what_is_wrong_with_a_picture_is_named_and_stamps_go_on(script, expected, delivered):
    camera, driver, _ = scripted(script)
    faults = []
    frames = drain(camera, 30, faults)
    assert kinds(faults) == expected
    assert driver.calls == ["open"]
    assert driver.grabs == 30 + len(script) - delivered
    assert increasing(frames).max() < 0.35


def test_a_camera_that_stays_at_another_size_is_opened_again():
    camera, driver, _ = scripted({n: (100.0 + n / 10, picture(n, (8, 4))) for n in range(10, 40)})
    faults = []
    drain(camera, 20, faults)
    assert kinds(faults) == ["size", "late", "recovered"]
    assert driver.calls[:3] == ["open", "close", "open"]


@pytest.mark.parametrize("set_s", [3600.0, -3600.0, 0.02])
def test_a_devices_stamps_follow_from_those_of_its_frames_though_its_clock_is_set(set_s):
    """As ROS 2 topics do when NTP sets the clock: what is published, wheels and IMU are by the clock as it is now."""
    camera, driver, clock = scripted()
    grab, ahead_s = driver.grab, 0.0
    driver.grab = lambda: (lambda given: (given[0] + ahead_s, given[1]))(grab())
    around = CameraAround(camera)
    for ahead_s in (0.0, set_s):
        frames = drain(around, 3)
        assert frames[-1].stamp_s - around.clock_offset_s == pytest.approx(clock() - 900.0 + ahead_s)


def test_the_rate_of_a_device_is_measured_once_there_are_enough_frames():
    camera, driver, _ = scripted(rate_hz=8.0)
    driver.period_s = 0.2  # whatever it states
    drain(camera, 30)
    assert camera.info.rate_hz == 8.0
    drain(camera, 1)
    assert camera.info.rate_hz == pytest.approx(5.0)


# This process may be kept waiting by others, so only a driver that says so is a fault.
PATIENT = CameraOptions(recovery=RecoveryRule(first_frame_limit_s=300.0, stall_limit_s=300.0))


class RealClock:
    """The machine's, as `ScriptedDriver` asks for it."""

    __call__, wait = staticmethod(time.monotonic), staticmethod(time.sleep)


def test_a_slow_reader_gets_the_newest_and_none_twice():
    driver = ScriptedDriver(RealClock(), rate_hz=100.0)
    with LiveCamera(driver, PATIENT) as camera:
        for index in (0, 2, 4):
            until = driver.grabs + 5
            wait_for(lambda until=until: driver.grabs >= until)
            newest, later = camera.read(), camera.read()
            assert (newest.index, later.index) == (index, index + 1)
            assert until - 2 <= newest.image[0, 0, 2] < later.image[0, 0, 2]  # each grab's picture has its number
    wait_for(lambda: driver.calls == ["open", "close"])


def test_a_picture_of_another_size_is_refused_and_after_close_is_the_end():
    camera, driver, clock = scripted()
    other = LiveCamera(driver, CameraOptions(Intrinsics(640, 480, 500, 500, 320, 240)), clock, clock.wait)
    with pytest.raises(CameraError, match="6x4, the intrinsics are for 640x480"):
        other.read()
    camera.close()
    camera.close()
    assert camera.read() is None


@pytest.mark.parametrize("serve", [MjpegServer, lambda: RtspServer(gradients())], ids=["http", "rtsp"])
def test_a_stream_that_goes_away_comes_back(serve, monkeypatch):
    # RTSP's four attempts take it in full.
    monkeypatch.setattr("edgemap.runtime.inputs.cameras.webcam.PATIENCE_S", 0.5)
    with serve() as server, LiveCamera(StreamDriver(server.url), PATIENT) as camera:
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
    told = rf"^http://\*\*\*@127\.0\.0\.1:{port}/x: no stream that FFmpeg reads"
    with pytest.raises(CameraError, match=told) as caught:
        open_camera(f"http://user:secret@127.0.0.1:{port}/x")
    assert "secret" not in str(caught.value)
