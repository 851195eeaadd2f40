"""What a run counts of itself, by hand-made results."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.results import COVARIANCE, POSES, results

from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.health import PictureHealth
from edgemap.runtime.motion.odometry.protocol import MotionState
from edgemap.runtime.outputs.verdict.run_counts import QualityCounter


def made(count=10):
    frames = [Frame(i, 0.2 * i, np.zeros((48, 64, 3), dtype=np.uint8)) for i in range(count)]
    return list(results(frames, POSES[:count]))


def changed(result, **observed):
    return replace(result, observed=replace(result.observed, **observed))


def test_what_is_counted():
    given = made()
    given[2] = changed(given[2], health=PictureHealth(Fault(FaultKind.DARK, "dark")))
    given[3] = changed(given[3], health=PictureHealth(Fault(FaultKind.REPEATED, "as before")), at_rest=True)
    motion = given[4].observed.motion
    given[4] = changed(given[4], motion=replace(motion, state=MotionState.BLIND))
    given[5] = changed(given[5], motion=replace(motion, members={"wheels": "used", "gyro": "left_out"}))
    counter = QualityCounter()
    for result in given:
        counter.add(result)
    found = counter.document()
    assert (found["frames"], found["blind_frames"], found["blind"]) == (10, 1, {"dark": 1})
    assert (found["guessed_frames"], found["still_frames"]) == (1, 1)
    assert (found["wheel_frames"], found["gyro_frames"], found["object_frames"]) == (1, 0, 10)
    assert found["wheels"]
    assert found["rate_hz"] == pytest.approx(5.0)
    assert found["duration_s"] == pytest.approx(1.8)
    largest = np.sqrt(np.linalg.eigvalsh(COVARIANCE[:2, :2])[-1])
    assert found["sigma_m"] == {"end": pytest.approx(largest, abs=1e-4), "largest": pytest.approx(largest, abs=1e-4)}
    assert found["heading_sigma_deg"]["end"] == pytest.approx(np.degrees(np.sqrt(0.03)), abs=1e-3)


def test_a_covariance_that_is_none_is_left_out():
    counter = QualityCounter()
    first, second = made(2)
    counter.add(first)
    counter.add(replace(second, pose_covariance=np.full((3, 3), np.nan)))
    assert json.dumps(counter.document(), allow_nan=False)
    assert counter.document()["sigma_m"]["end"] > 0.1
    assert not counter.document()["wheels"]


def test_before_the_first_frame_there_is_a_document():
    assert json.dumps(QualityCounter().document(), allow_nan=False)
