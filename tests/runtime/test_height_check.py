"""A mount's height is checked by what stands on the floor, and by the wheels; one that was guessed is corrected, and
the map is saved at the scale of its estimate."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from support.drives import exact, observed, round_trip, sighted
from support.rooms import content_of, furnished

from edgemap.geometry.camera.attitude import Attitude, MountEstimate
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.motion.height_check import HeightCheck
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.outputs.verdict.causes import CAUSE_OF, CAUSES
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap
from edgemap.runtime.step.slam import SlamOptions, StepResult, build_slam

LENS = Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
NAMES = ("chair", "tv")


def chair(camera, away_m):
    """The box of one whose near side stands straight ahead."""
    corners = [(x, y, z) for x in (away_m, away_m + 0.5) for y in (-0.25, 0.25) for z in (0.0, 0.85)]
    pixels = camera.project(corners) + 0.5
    box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    return Detections(box[None], np.array([0.9]), np.zeros(1, np.int64), NAMES)


@pytest.mark.parametrize(("given", "wrong"), [(0.4, True), (0.6, False)])
def test_the_demo_with_a_wrong_height_is_a_fault_that_names_the_likelier_one(demo, given, wrong):
    floor = FloorCamera(demo.camera.info.intrinsics, replace(demo.camera.info.mount, height_m=given))
    faults, heights = [], []
    slam = build_slam(demo.camera, demo.bundle, floor, SlamOptions(wheels=False))
    for index, (image, stamp_s) in enumerate(zip(demo.images, demo.stamps_s, strict=True)):
        if stamp_s > 12.0 or faults:
            break
        observed = slam.step(Frame(index, stamp_s, image)).observed
        faults = [fault for fault in observed.faults if fault.kind is FaultKind.MOUNT_HEIGHT]
        heights += [observed.height_estimate] if observed.height_estimate else []
    assert bool(faults) == wrong
    assert heights[-1].height_m == pytest.approx(0.6, abs=max(0.06, 2.0 * heights[-1].sigma_m))
    if wrong:
        assert heights[-1].height_m == pytest.approx(0.6, abs=0.06)
        assert f"would make it {heights[-1].height_m:.2f} m" in faults[0].text


def by_wheels(scale, count=300, sigma_m=0.0005, slip=0, boxes=None):
    """Faults of a robot that rolls 5 cm a step and whose camera measures `scale` times that; the last steps slip."""
    random, mount = np.random.default_rng(0), Mount(0.6, 0.1)
    camera, check, faults = FloorCamera(LENS, mount), HeightCheck(mount), []
    for index in range(count):
        rolled_m = 0.05 * (2.0 if index >= count - slip else 1.0)
        lengths = 0.05 * scale + random.normal(0.0, sigma_m), rolled_m
        motion = Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-6, lengths=lengths)
        fault = check.judge(index / 10.0, camera, boxes or Detections.none(NAMES), motion)
        faults += [(index / 10.0, fault)] if fault else []
    return faults


@pytest.mark.parametrize(("scale", "height"), [(1.4, "0.43"), (0.7, "0.86")])
def test_wheels_name_the_likelier_height_once(scale, height):
    ((stamp_s, fault),) = by_wheels(scale)
    assert stamp_s <= 12.0
    assert f"height 0.60 m given, the wheels would make it {height} m" in fault.text
    assert CAUSE_OF.get(fault.kind) is CAUSES["scale"]  # what `edgemap why` makes of it


def test_wheels_that_agree_or_scatter_or_slip_for_a_moment_say_nothing_of_the_height():
    assert not by_wheels(1.0)
    assert not by_wheels(1.1)
    assert not by_wheels(1.0, slip=12)
    assert not by_wheels(1.15, sigma_m=0.01)
    assert not by_wheels(-1.0)


@pytest.mark.parametrize(("true", "height"), [(1.1, None), (1.4, "0.9[0-9]")])
def test_wheels_are_wrong_where_objects_are_nearer_to_the_given_height(true, height):
    """Wheels that would make the lens 1.6 times as high, and chairs as a lens `true` times as high sees them."""
    found = by_wheels(1.0 / 1.6, boxes=chair(FloorCamera(LENS, Mount(0.6 * true, 0.1)), 2.5))
    assert len(found) == (height is not None)
    if height is not None:
        assert re.search(f"usual height of chair and the wheels would make it {height} m", found[0][1].text)


# A lens 0.6 m up that is taken for 0.72 m, and what it sees.
TAKEN, BOXES = Mount(0.72, 0.1), chair(FloorCamera(LENS, Mount(0.6, 0.1)), 2.5)
BY_SIZES = 0.6 / 0.72


def seen(check, indices, boxes=BOXES, mount=TAKEN, attitude=None, **measured):
    """Judges so many frames, ten a second, which are no fault. measured: motion, depth."""
    for index in indices:
        given = {"motion": Motion()} | measured
        camera = FloorCamera(LENS, mount, attitude)
        assert not check.judge(index / 10, camera, boxes, **given)


@pytest.mark.parametrize("guessed", [0.0, 0.1, 0.3])
def test_a_guess_moves_to_sizes_of_objects_that_are_surer_than_it_and_a_given_height_never(guessed):
    check = HeightCheck(TAKEN, guessed=guessed)  # the sizes are known to 13 %
    seen(check, range(200))
    assert check.scale == (pytest.approx(BY_SIZES, abs=0.04) if guessed == 0.3 else 1.0)
    assert (check.estimate is None) == (guessed == 0.1)
    assert check.estimate is None or check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_wheels_measure_the_path_so_its_scale_stays():
    check = HeightCheck(TAKEN, guessed=0.3)
    seen(check, range(200), motion=Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-6, lengths=(0.06, 0.05)))
    assert check.scale == 1.0
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.02)


@pytest.mark.parametrize("measured", [{"depth": True}, {"motion": Motion(lengths=(0.0, 0.0))}])
@pytest.mark.parametrize("begins", [0, 150])
def test_a_robot_that_turns_in_place_has_wheels_or_depth_all_the_same(measured, begins):
    """The path is measured from then on, whatever the sizes have shown: 50 cm rolled are not waited for."""
    check = HeightCheck(TAKEN, guessed=0.3)
    for index in range(200):
        seen(check, [index], **(measured if index >= begins else {}))
        assert (check.scale == 1.0) == (index < 100 or index >= begins)
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_a_correction_of_the_mount_keeps_the_sizes():
    """Pitch 3 degrees too steep for 20 s, then right, and no box more: the boxes so far give the height by the right
    pitch."""
    steep = replace(TAKEN, pitch_rad=0.1 + math.radians(3.0))
    estimate = MountEstimate(TAKEN, np.full(2, 0.005), TAKEN, steep)
    corrected = replace(Attitude.of_mount(TAKEN), mount=estimate)
    for guessed in (0.3, 0.0):
        check = HeightCheck(steep, guessed=guessed)
        seen(check, range(200), mount=steep)
        assert check.estimate.height_m > 0.66
        seen(check, range(200, 400), Detections.none(NAMES), attitude=corrected)
        assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)
        assert check.scale == pytest.approx(BY_SIZES if guessed else 1.0, abs=0.04)


ROOM = furnished(np.random.default_rng(5), 12, apart_m=1.5)
POSES = round_trip(200, turns=1.8)
FACTOR = 1.25
FLOOR = FloorCamera(LENS, Mount(0.6))


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
    known.start_in(SavedMap(earlier), SE2())
    lost.relocalise_in(SavedMap(earlier))
    for mapper in (known, lost):
        result, _ = next(results(mapper, 0))
        assert (result.observed.scale, result.scale) == (FACTOR, 1.0)
