"""What a camera's source knows, as `run` judges a map by it; and how that is told."""

import numpy as np

from edgemap.cli.summary import judge_of, object_lines
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera

CHAIR = MapObject("chair-1", "chair", np.array([2.0, 0.3]), np.eye(2) * 0.01, 0.5, 0.9, 9, 1.0, 0.0, 1.0)


class World(Camera):
    """A camera that knows its world, as sim:SEED does."""

    def __init__(self, *records):
        super().__init__(CameraInfo("sim"))
        self.records = list(records)

    def object_records(self):
        return self.records


def record(label, x_m, frames=20):
    return {"id": 1, "label": label, "x_m": x_m, "y_m": 0.0, "on_floor": True, "visible_frames": frames}


def test_a_simulated_world_judges_by_what_it_has_shown():
    judge = judge_of("sim:9150", World(record("chair", 2.0), record("bed", 5.0), record("tv", 7.0, frames=2)), None)
    assert judge is not None
    assert [(row.state, row.label) for row in judge([CHAIR], 60)] == [("found", "chair"), ("missed", "bed")]
    judge = judge_of("sim:9150", World(record("chair", 2.0), record("bed", 5.0)), {"chair"})
    assert judge is not None
    assert [row.state for row in judge([CHAIR], 60)] == ["found"]


def test_a_simulated_world_judges_at_its_own_pace_too():
    judge = judge_of("sim:9150", PacedCamera(World(record("chair", 2.0))), None)
    assert judge is not None
    assert [row.state for row in judge([CHAIR], 60)] == ["found"]


def test_the_demo_is_judged_and_a_webcam_is_not():
    from edgemap.runtime.inputs.open import open_camera

    with open_camera("demo") as camera:
        judge = judge_of("demo", camera, None)
        assert judge is not None
        assert {row.state for row in judge([], 10_000)} == {"missed"}
        assert judge([], 0) == []  # nothing was seen yet, nothing is asked for
    assert judge_of("0", Camera(CameraInfo("0")), None) is None


def test_lines_tell_each_object_what_is_missing_and_the_sum():
    judge = judge_of("sim:1", World(record("chair", 2.0), record("bed", 5.0)), None)
    assert judge is not None
    first, second, last = object_lines([CHAIR], judge([CHAIR], 60))
    assert first.endswith("found, 0.30 m off")
    assert second.split() == ["bed", "x", "5.00", "m", "y", "0.00", "m", "missed"]
    assert last == "against the truth: 1 found, 1 missed; median error 0.30 m"
    assert object_lines([], []) == []
