"""What a camera's source knows, as `run` judges a map by it; how that is reported; what a run leaves to look at."""

import gc

import numpy as np

from edgemap.cli import drive, main
from edgemap.cli.summary import judge_of, object_lines
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera
from edgemap.runtime.network.network import Network

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


def test_a_simulated_world_judges_by_what_it_has_shown_and_lines_tell_it():
    judge = judge_of("sim:9150", World(record("chair", 2.0), record("bed", 5.0), record("tv", 7.0, frames=2)), None)
    assert [(row.state, row.label) for row in judge([CHAIR], 60)] == [("found", "chair"), ("missed", "bed")]
    # At its own pace too.
    judge = judge_of("sim:9150", PacedCamera(World(record("chair", 2.0), record("bed", 5.0))), {"chair"})
    assert [row.state for row in judge([CHAIR], 60)] == ["found"]
    judge = judge_of("sim:1", World(record("chair", 2.0), record("bed", 5.0)), None)
    first, second, last = object_lines([CHAIR], judge([CHAIR], 60))
    assert first.endswith("found, 0.30 m off")
    assert second.split() == ["bed", "x", "5.00", "m", "y", "0.00", "m", "missed"]
    assert last == "against the truth: 1 found, 1 missed; median error 0.30 m"
    assert object_lines([], []) == []


def test_a_drive_with_truth_ends_with_verdicts(edgemap, painted_bundle, known_drive, tmp_path):
    flags = ("--bundle", painted_bundle, "--out", tmp_path / "run")
    result = edgemap.ok("run", "--camera", f"drive:{known_drive}", *flags)
    lines = result.stdout.splitlines()
    assert any(line.split()[0] == "chair-1" and "found, 0.0" in line for line in lines)
    assert any(line.split()[0] == "couch" and line.endswith("missed") for line in lines)
    assert any(line.startswith("against the truth: 1 found, 1 missed; median error 0.0") for line in lines)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "1 found, 1 missed" in page
    assert str(tmp_path / "run" / "report.html") in result.stdout
    done = edgemap("run", "--camera", f"drive:{known_drive}", *flags[:-1], tmp_path / "chairs", "--classes", "chair")
    assert "truth: 1 found;" in done.stdout  # classes that were not asked for are not missed


def test_a_run_keeps_no_network_for_rows_that_its_pictures_do_not_reach(tmp_path, monkeypatch):
    def whole_networks():
        gc.collect()
        return sum(isinstance(one, Network) and one.inputs.get("image", (0,) * 4)[2] == 416 for one in gc.get_objects())

    before, during, steps = whole_networks(), [], drive.steps
    monkeypatch.setattr(drive, "steps", lambda *given: during.append(whole_networks()) or steps(*given))
    main(["run", "--frames", "1", "--threads", "1", "-o", str(tmp_path / "run")])
    assert during == [before]
