"""The page's state: what viewers get, pauses, pictures, and the sentence that comes first."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.faults import made
from support.live_camera import Clock
from support.made_camera import MadeCamera
from support.steps import Steps

from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera
from edgemap.runtime.motion.health import PictureHealth
from edgemap.runtime.step.sinks import SinkGroup
from edgemap.view.page import RATE_OVER, LivePage, Tail
from edgemap.view.pause import PausableCamera, Pause
from edgemap.view.status import NEWS_S, status
from edgemap.view.updates import LONGEST_PX, shown_jpeg


@given(st.integers(1, 6), st.lists(st.tuples(st.booleans(), st.integers(1, 4)), max_size=40))
def test_readers_of_a_tail_get_every_item_that_is_still_there_once(limit, moves):
    """Against a plain list: each read gives the items from where the last stopped, less those that fell off."""
    tail, everything, read, number = Tail(limit), [], [], 0
    for is_read, most in moves:
        if is_read:
            kept_from = max(number, len(everything) - limit)
            items, number = tail.since(number, most)
            assert items == everything[kept_from : kept_from + most]
            read += items
        else:
            tail.append(len(everything))
            everything.append(len(everything))
    assert read == sorted(set(read))


def test_the_trail_is_the_way_and_a_lasting_fault_is_told_once(tmp_path):
    page, steps, few = LivePage({}, tmp_path), Steps(), made("few corners")
    for fault in (None, few, few, None, few):
        SinkGroup([page]).write(*steps.next(fault))
    trail, _ = page.trail.since(0, 99)
    np.testing.assert_allclose([sample[:3] for sample in trail], [(0.05 * i, 0.0, 0.1 * i) for i in range(5)])
    assert page.faults.since(0, 99)[0] == [replace(few, frame=1), replace(few, frame=4)]
    result, objects = steps.next()
    for _ in range(5):  # a robot that stands leaves no trail
        page.write(result, objects)
    assert len(page.trail.since(0, 99)[0]) == 6


def indices(camera, count):
    return [None if frame is None else frame.index for frame in (camera.read() for _ in range(count))]


def test_after_a_pause_frames_keep_their_pace_and_none_is_lost(monkeypatch):
    """Stamps are 0.4 s apart; the clock is the test's own, and sleeping moves it. A pause of 30 s between two."""
    clock = Clock()
    monkeypatch.setattr("time.sleep", clock.wait)
    pause = Pause(clock)
    five = MadeCamera(5, lambda _: np.zeros((4, 4, 3), np.uint8), rate_hz=2.5)
    camera = PausableCamera(PacedCamera(five, pause.running_s), pause, lambda: False)
    assert indices(camera, 2) == [0, 1]
    pause.set(True)
    clock.now_s += 30.0
    pause.set(True)  # twice is once
    pause.set(False)
    assert indices(camera, 4) == [2, 3, 4, None]
    assert clock.waits == pytest.approx([0.4] * 4)


def test_a_frame_is_encoded_once_and_a_waiting_viewer_is_woken_once(tmp_path):
    image = np.zeros((600, 2 * LONGEST_PX, 3), np.uint8)
    image[:, LONGEST_PX:] = (0, 0, 255)  # the right half is red
    frame = Frame(0, 0.0, image)
    jpeg = shown_jpeg(frame)
    assert shown_jpeg(frame) is jpeg
    shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (300, LONGEST_PX, 3)
    np.testing.assert_allclose(shown[150, LONGEST_PX - 20], (0, 0, 255), atol=6)
    np.testing.assert_allclose(shown[150, 20], (0, 0, 0), atol=6)
    page, steps, calls = LivePage({}, tmp_path), Steps(), []
    steps.into(page, 3)
    page.wake_once(lambda: calls.append(page.revision))
    steps.into(page, 3)
    assert calls == [4]


@pytest.fixture
def clock(monkeypatch):
    """now[0]: what `time.monotonic` tells page and status."""
    now = [1000.0]
    monkeypatch.setattr("edgemap.view.page.time.monotonic", lambda: now[0])
    return now


def page_of(tmp_path, clock, count=RATE_OVER, rate_hz=10.0, **more):
    page, steps = LivePage({"rate_hz": 10.0}, tmp_path, Pause(), **more), Steps()
    for _ in range(count):
        clock[0] += 1.0 / rate_hz
        page.write(*steps.next())
    return page, steps


def items(page):
    return [(problem.level, problem.what, problem.text) for problem in status(page)["problems"]]


def test_overload_is_told_with_its_figures_once_there_are_enough_steps(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(LivePage, "step_ms", lambda page: 141.7)  # a step's own time is the machine's
    page, _ = page_of(tmp_path, clock, rate_hz=6.0)
    text = "Overloaded: 6.0 of 10 pictures a second, 142 ms each."
    assert items(page) == [("degraded", "speed", text)]
    assert status(page)["headline"] == text
    assert items(page_of(tmp_path, clock, count=RATE_OVER - 1, rate_hz=6.0)[0]) == []


def test_a_camera_slower_than_it_states_is_no_overload(tmp_path, clock):
    """As a webcam in dim light, and every MJPEG stream, which FFmpeg takes for 25 Hz."""
    for rate_hz in (10.0, 6.0):
        page, _ = page_of(tmp_path, clock, rate_hz=rate_hz)
        assert 10.0 < page.step_ms() < 80.0
        headline = f"Running, {rate_hz} pictures a second."
        assert status(page) == {"level": "ok", "headline": headline, "problems": []}


def test_a_camera_that_is_away_comes_before_everything_else(tmp_path, clock):
    state = ["running"]
    page, steps = page_of(tmp_path, clock, camera_state=lambda: state[0])
    page.write(*steps.next(made("window odometry: 3 corners on the floor")))
    clock[0] += 7.0
    assert [problem[:2] for problem in items(page)] == [("fault", "camera"), ("degraded", "odometry")]
    state[0] = "degraded"
    assert status(page)["headline"] == "No picture for 7 s. The camera is being restarted."
    state[0] = "lost"
    assert status(page)["headline"] == "The camera is lost. The map so far is saved."


def test_a_blind_picture_is_a_fault_and_a_repeated_one_is_not(tmp_path, clock):
    page, steps = page_of(tmp_path, clock)
    for kind, level in ((FaultKind.DARK, "fault"), (FaultKind.FROZEN, "degraded")):
        result, objects = steps.next()
        clock[0] += 0.1
        blindness = Fault(kind, "why")
        page.write(replace(result, observed=replace(result.observed, health=PictureHealth(blindness))), objects)
        page.fault(blindness)
        assert items(page) == [(level, "picture", "The picture has no information: why.")]


def test_an_uncertain_pose_is_told_and_a_held_or_finished_run_has_no_problems(tmp_path, clock):
    page, steps = page_of(tmp_path, clock)
    result, objects = steps.next()
    page.write(replace(result, pose_covariance=np.diag([0.64, 0.64, 0.01])), objects)
    assert items(page) == [("degraded", "pose", "The position is uncertain: ± 0.8 m, ± 6°.")]
    page, _ = page_of(tmp_path, clock, rate_hz=6.0)
    page.set_paused(True)
    assert status(page) == {"level": "ok", "headline": "Paused.", "problems": []}
    page.close()
    assert status(page)["headline"] == "The run is over. This is the map it saved."


def test_what_somebody_reports_stays_for_a_while(tmp_path, clock):
    page, steps = page_of(tmp_path, clock)
    page.fault(Fault(FaultKind.OUTPUT, "map.json: cannot be written (No space left on device)"))
    assert status(page)["headline"] == "map.json: cannot be written (No space left on device)."
    for _ in range(RATE_OVER):
        clock[0] += NEWS_S / RATE_OVER
        page.write(*steps.next())
    assert "report" not in {what for _, what, _ in items(page)}
