"""What the page says first: one sentence, the worst first."""

from dataclasses import replace

import numpy as np
import pytest
from support.faults import made
from support.steps import Steps

from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.health import PictureHealth
from edgemap.view.page import RATE_OVER, LivePage
from edgemap.view.pause import Pause
from edgemap.view.status import NEWS_S, status


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


def test_all_well_is_said_with_its_rate(tmp_path, clock):
    page, _ = page_of(tmp_path, clock)
    assert status(page) == {"level": "ok", "headline": "Running, 10.0 pictures a second.", "problems": []}


def test_overload_is_told_with_its_figures(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(LivePage, "step_ms", lambda page: 141.7)  # a step's own time is the machine's
    page, _ = page_of(tmp_path, clock, rate_hz=6.0)
    text = "Overloaded: 6.0 of 10 pictures a second, 142 ms each."
    assert items(page) == [("degraded", "speed", text)]
    assert status(page)["headline"] == text


def test_a_camera_slower_than_it_states_is_no_overload(tmp_path, clock):
    """As a webcam in dim light, and every MJPEG stream, which FFmpeg takes for 25 Hz."""
    page, _ = page_of(tmp_path, clock, rate_hz=6.0)
    assert 10.0 < page.step_ms() < 80.0
    assert status(page) == {"level": "ok", "headline": "Running, 6.0 pictures a second.", "problems": []}


def test_too_few_steps_are_no_overload(tmp_path, clock):
    assert items(page_of(tmp_path, clock, count=RATE_OVER - 1, rate_hz=6.0)[0]) == []


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


def test_an_uncertain_pose_is_told(tmp_path, clock):
    page, steps = page_of(tmp_path, clock)
    result, objects = steps.next()
    page.write(replace(result, pose_covariance=np.diag([0.64, 0.64, 0.01])), objects)
    assert items(page) == [("degraded", "pose", "The position is uncertain: ± 0.8 m, ± 6°.")]


def test_what_somebody_reports_stays_for_a_while(tmp_path, clock):
    page, steps = page_of(tmp_path, clock)
    page.fault(Fault(FaultKind.OUTPUT, "map.json: cannot be written (No space left on device)"))
    assert status(page)["headline"] == "map.json: cannot be written (No space left on device)."
    for _ in range(RATE_OVER):
        clock[0] += NEWS_S / RATE_OVER
        page.write(*steps.next())
    assert "report" not in {what for _, what, _ in items(page)}


def test_a_held_and_a_finished_run_have_no_problems(tmp_path, clock):
    page, _ = page_of(tmp_path, clock, rate_hz=6.0)
    page.set_paused(True)
    assert status(page) == {"level": "ok", "headline": "Paused.", "problems": []}
    page.close()
    assert status(page)["headline"] == "The run is over. This is the map it saved."
