"""A guessed height of the lens proves another: the map is saved at the scale of its estimate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.drives import exact, observed, round_trip, sighted
from support.rooms import content_of, furnished

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.slam import StepResult

ROOM = furnished(np.random.default_rng(5), 12, apart_m=1.5)
POSES = round_trip(200, turns=1.8)
FACTOR = 1.25
FLOOR = FloorCamera(Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5), Mount(0.6))


def results(mapper, changes_at):
    """A drive in which the lens proves FACTOR times as high as guessed from a frame on, and the map after each step."""
    random = np.random.default_rng(3)
    for index, (pose, motion) in enumerate(zip(POSES, exact(POSES), strict=True)):
        boxes = Detections(np.zeros((20, 4)), np.full(20, 0.8), np.zeros(20, np.int64), ("thing",))
        seen = observed(index, sighted(ROOM, pose, index, random), replace(motion, covariance=np.eye(3) * 1e-5), boxes)
        seen = replace(seen, scale=FACTOR if index >= changes_at else 1.0)
        frame = Frame(index, index / 10, np.zeros((480, 640, 3), np.uint8))
        yield StepResult.of(frame, seen, mapper.step(seen)), mapper.objects()


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The folders of one drive by a given height and by a guess that is FACTOR too low, and the latter's last result.
    While it lasts, both are the same."""
    folders = []
    for changes_at in (1000, 120):
        where, mapper = tmp_path_factory.mktemp("scale"), Mapper(closes_loops=True)
        sinks = [RunFolder(where / "run", FLOOR, {}), LivingMap(where / "home", bool)]
        for index, (result, objects) in enumerate(results(mapper, changes_at)):
            if index == 1:
                mapper.edit(Edit("zone", name="rug", corners_m=((1.0, 0.0), (2.0, 0.0), (2.0, 1.0))))
                mapper.edit(Edit("dock", pose=(0.4, -0.2, 1.0)))
                mapper.edit(Edit("add", label="chair", place_m=(2.0, 2.0), size_m=(0.4, 0.5, 0.9)))
            for sink in sinks:
                sink.write(result, objects)
        during = content_of(where / "run"), content_of(where / "home")
        for sink in sinks:
            sink.close()
        folders.append((where, during, result))
    (given, during, _), (guessed, same, result) = folders
    assert during == same
    return given, guessed, result


@pytest.mark.parametrize("name", ["run", "home"])
def test_a_map_is_saved_at_the_scale_of_the_estimate(saved, name):
    """Objects, zones and dock; the size that a person has measured stays."""
    given, guessed, result = saved
    (before, zones), (after, scaled_zones) = (load_annotated_map(folder / name) for folder in (given, guessed))
    assert [item.id for item in after] == [item.id for item in before]
    for item, like in zip(after, before, strict=True):
        assert item.position_m == pytest.approx(FACTOR * like.position_m, abs=1e-5)
        assert item.covariance_m2 == pytest.approx(FACTOR**2 * like.covariance_m2, abs=1e-8)
        size = 1.0 if item.corrected else FACTOR
        assert (item.width_m, item.height_m) == pytest.approx((size * like.width_m, size * like.height_m), abs=1e-3)
    corners = (np.array(one.zones[0].corners_m) for one in (scaled_zones, zones))
    np.testing.assert_allclose(next(corners), FACTOR * next(corners), atol=1e-3)
    assert scaled_zones.dock.vector() == pytest.approx(zones.dock.vector() * [FACTOR, FACTOR, 1.0], abs=1e-3)
    if name == "home":
        last = load_annotated_map(guessed / name)[1].last_pose
        assert last.vector() == pytest.approx(result.pose_map_base.scaled(FACTOR).vector(), abs=1e-3)


def test_trajectory_sightings_and_record_take_it_too(saved):
    given, guessed, result = saved
    before, after = (trajectory_of(folder / "run") for folder in (given, guessed))
    for pose, like in zip(after.poses, before.poses, strict=True):
        assert pose.vector() == pytest.approx(like.scaled(FACTOR).vector(), abs=1e-4)
    lengths = {"base_m", "map_m", "distance_m", "width_m", "height_m"}
    lines = [(folder / "run" / "sightings.jsonl").read_text().splitlines() for folder in (given, guessed)]
    for like, seen in (map(json.loads, pair) for pair in zip(*lines, strict=True)):
        assert seen.pop("scale") == FACTOR
        for name, value in like.items():
            assert seen[name] == (pytest.approx(np.multiply(FACTOR, value), abs=2e-4) if name in lengths else value)
    records = [json.loads((folder / "run" / "run.json").read_text()) for folder in (given, guessed)]
    assert records[1]["mount_seen"]["used_height_m"] == pytest.approx(FACTOR * 0.6)
    assert "mount_seen" not in records[0]
    assert records[1]["quality"]["travelled_m"] == pytest.approx(FACTOR * result.travelled_m, abs=1e-3)


def test_an_earlier_map_keeps_its_scale():
    earlier = [MapObject("chair-1", "chair", np.array([2.0, 1.0]), np.eye(2) * 0.01, 0.5, 0.9, 9, 0.9, 0.0, 1.0)]
    known, lost = Mapper(), Mapper()
    known.start_in(earlier, SE2())
    lost.relocalise_in(earlier)
    for mapper in (known, lost):
        result, _ = next(results(mapper, 0))
        assert (result.observed.scale, result.scale) == (FACTOR, 1.0)
