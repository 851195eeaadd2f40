"""A detector beside the step: its boxes belong to the picture that they were found in, and no step waits for it."""

import json
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import painted
from support.noise import noise

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.pictures import PicturesCamera
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.loop import run
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam

FLOOR = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))
POSES = tuple(SE2(0.3 * index, 0.05 * index, 0.1 * index) for index in range(9))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    scene = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)]
    return load_bundle(painted.write_painted(tmp_path_factory.mktemp("bundles") / "b", scene), 1)


def slam_of(bundle):
    odometry = RecordedOdometry(Trajectory(np.arange(9) / 10, POSES), "test")
    return SemanticSlam(Pipeline(bundle, FLOOR, odometry), Mapper())


def frame(index, search=True):
    return Frame(index, index / 10, noise(index), search=search)


@pytest.mark.parametrize("every", [1, 3])
def test_boxes_are_placed_by_the_pose_of_their_picture(bundle, every):
    alone, beside = slam_of(bundle), slam_of(replace(bundle, companion=bundle))
    expected = {}
    for index in range(9):
        result = alone.step(frame(index, index % every == 0))
        expected[index] = [placed.position_map_m for placed in result.sightings]
        late = beside.step(frame(index, index % every == 0))
        assert late.observed.searched == (index >= every and index % every == 0)
        if late.observed.searched:
            assert late.pictured.index == index - every
            assert [placed.sighting.frame for placed in late.sightings] == [index - every]
            np.testing.assert_allclose([one.position_map_m for one in late.sightings], expected[index - every])
    np.testing.assert_allclose(late.pose_map_base.vector(), result.pose_map_base.vector())
    late = beside.finish()
    assert late is not None
    newest = max(expected) // every * every
    assert [placed.sighting.frame for placed in late.sightings] == [newest]
    np.testing.assert_allclose([one.position_map_m for one in late.sightings], expected[newest])
    assert (late.frame.index, late.pictured.index) == (8, newest)
    assert beside.finish() is alone.finish() is None


def test_a_run_writes_the_boxes_of_the_last_picture_too(bundle, tmp_path):
    written, pictures = {}, [tmp_path / f"{index}.png" for index in range(9)]
    for index, path in enumerate(pictures):
        cv2.imwrite(str(path), noise(index))
    for name, one in {"alone": bundle, "beside": replace(bundle, companion=bundle)}.items():
        camera = PicturesCamera(name, pictures, np.arange(9) / 10, FLOOR.intrinsics)
        slam = slam_of(one)
        assert run(camera, slam, [RunFolder(tmp_path / name, FLOOR, {})]) == 9
        lines = (tmp_path / name / "sightings.jsonl").read_text().splitlines()
        frames = len((tmp_path / name / "trajectory.tum").read_text().splitlines())
        written[name] = [(json.loads(line)["frame"], json.loads(line)["map_m"]) for line in lines], frames
    assert [frame for frame, _ in written["alone"][0]] == list(range(9))
    assert written["alone"] == written["beside"]


def test_at_a_cameras_pace_no_step_waits_and_a_replay_of_its_marks_gives_the_same(bundle):
    gate = threading.Event()
    network = replace(bundle.backbone, infer=lambda tensors: gate.wait(10.0) and bundle.backbone.infer(tensors))
    live = slam_of(replace(bundle, backbone=network, companion=bundle, paced=True))
    results = [live.step(frame(index)) for index in range(4)]  # returns, as nothing waits for the gate
    assert [result.frame.search for result in results] == [True, False, False, False]
    gate.set()
    while live.pipeline.marked(frame(4)).search is False:
        pass
    results.append(live.step(frame(4)))
    assert results[-1].pictured.index == 0
    replay = slam_of(replace(bundle, companion=bundle))
    for result in results:
        again = replay.step(result.frame)
        assert [one.position_map_m.tolist() for one in again.sightings] == [
            one.position_map_m.tolist() for one in result.sightings
        ]
