import json
import threading
from dataclasses import replace

import numpy as np
import pytest
from support import painted
from support.drives import exact, observed, round_trip, sighted
from support.made_camera import MadeCamera, raising
from support.painted import FLOOR, slam_of
from support.pictures import noise
from support.rooms import furnished

from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.step.mapper import Mapper

# Lower edge at row 42: 10 px below the horizon, hence 5 m ahead; the person is never mapped.
SCENE = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9), ("person", 10.0, 40.0, 8.0, 20.0, 0.8)]


def memory(count, before=None):
    """Pictures of noise."""
    return MadeCamera(count, noise, before=before, frame_count=count)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return load_bundle(painted.write_painted(tmp_path_factory.mktemp("bundles") / "b", SCENE))


def pipeline(bundle, paper=None):
    return slam_of(bundle, [SE2()] * 100, paper)


def test_a_picture_that_is_not_searched_shows_no_worktop(bundle):
    slam = pipeline(bundle)
    slam.step(Frame(0, 0.0, noise(0)))
    dark = slam.step(Frame(1, 0.1, np.zeros((64, 64, 3), np.uint8))).observed
    assert (dark.searched, dark.worktop) == (False, False)


@pytest.mark.parametrize("paper", [None, PaperMap()])
def test_one_chair_seen_ten_times_is_one_object_where_geometry_says(bundle, paper):
    pipe = pipeline(bundle, paper)
    for index in range(10):
        result = pipe.step(Frame(index, index / 10, noise(index)))
    assert result.detections.labels == ["chair", "person"]
    (chair,) = pipe.objects()
    assert (chair.id, chair.count) == ("chair-1", 10)
    # A chair that looks wide, 0.86 m or more: its middle is 0.13 + 0.23 * 0.86 m behind its lower edge.
    assert np.linalg.norm(chair.position_m) == pytest.approx(np.hypot(5.0, 0.8) + 0.328, abs=0.01)
    assert chair.position_m[1] < 0


def test_a_frame_of_another_size_is_named_and_stop_ends_after_the_frame_in_hand(bundle, tmp_path):
    with pytest.raises(CameraError, match=r"frame 0 x\.png is 32x64 px, the intrinsics are for 64x64"):
        pipeline(bundle).step(Frame(0, 0.0, np.zeros((64, 32, 3), np.uint8), "x.png"))
    stop = threading.Event()
    camera = memory(50, lambda index: stop.set() if index == 4 else None)
    assert len(list(steps(camera, pipeline(bundle), [RunFolder(tmp_path / "run", FLOOR, {})], stop=stop))) == 5


def test_the_run_folder_holds_the_contract(bundle, tmp_path):
    pipe = pipeline(bundle)
    sink = RunFolder(tmp_path / "run", FLOOR, {"camera": "memory"})
    assert load_map(tmp_path / "run") == []  # an empty valid map before the first frame
    assert len(list(steps(memory(25), pipe, [sink]))) == 25
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        "map.json", "grid.npz", "trajectory.tum", "sightings.jsonl", "run.json", "mount.jpg",
    }  # fmt: skip
    assert [item.id for item in load_map(tmp_path / "run")] == ["chair-1"]
    assert len(trajectory_of(tmp_path / "run" / "trajectory.tum").poses) == 25
    sightings = [json.loads(line) for line in (tmp_path / "run" / "sightings.jsonl").read_text().splitlines()]
    assert len(sightings) == 25
    assert {"frame", "label", "map_m", "object", "distance_m"} <= set(sightings[0])
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["finished"] is True
    assert record["frames"] == 25
    assert set(record["stages_ms"]["backbone"]) == {"p50", "p95", "p99"}
    assert record["attitude_sources"] == {"mount": 25}  # by wheels alone no corners are tracked


@pytest.mark.parametrize(("error", "ended"), [(CameraError("it came off"), ["it came off"]), (ZeroDivisionError(), [])])
def test_a_failure_loses_nothing_of_the_map(bundle, tmp_path, error, ended):
    """A known one is in the record as well."""
    sink = RunFolder(tmp_path / "run", FLOOR, {})
    with pytest.raises(type(error)):
        list(steps(memory(50, raising(13, error)), pipeline(bundle), [sink]))
    (chair,) = load_map(tmp_path / "run")
    assert chair.count == 13
    faults = json.loads((tmp_path / "run" / "run.json").read_text())["faults"]
    expected = [{"kind": "ended", "frame": 13, "text": text} for text in ended]
    assert [fault for fault in faults if fault["kind"] == "ended"] == expected


ROOM = furnished(np.random.default_rng(5), 12, apart_m=1.0)
WAY = round_trip(3 * 120, turns=1.1)  # 12 s at 30 Hz


def mapped(every, room=ROOM, way=WAY):
    """The map of a drive of which every so many pictures of 30 Hz are taken."""
    mapper, random = Mapper(), np.random.default_rng(0)
    poses = way[::every]
    for index, (pose, motion) in enumerate(zip(poses, exact(poses), strict=True)):
        stamp_s = index * every / 30.0
        sightings = [replace(seen, stamp_s=stamp_s) for seen in sighted(room, pose, index, random)]
        known = Motion(motion.motion, np.eye(3) * 1e-8)
        mapper.step(replace(observed(index, sightings, known), stamp_s=stamp_s))
    return mapper.objects()


def off_m(a, b):
    """Distance of two objects."""
    return float(np.linalg.norm(a.position_m - b.position_m))


@pytest.mark.parametrize("every", [1, 6, 9])
def test_the_map_does_not_depend_on_the_rate(every):
    usual, other = mapped(3), mapped(every)
    assert len(usual) >= 8
    assert abs(len(other) - len(usual)) <= 1  # one may be in view for just long enough
    for item in usual if len(usual) <= len(other) else other:
        there = other if len(usual) <= len(other) else usual
        near = min((seen for seen in there if seen.label == item.label), key=lambda seen: off_m(seen, item))
        assert off_m(near, item) < 0.15
        assert near.confidence == pytest.approx(item.confidence, abs=0.08)
