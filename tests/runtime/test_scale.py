"""A guessed height of the lens becomes another: map, trajectory, grid and edits take its scale."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false, reportAttributeAccessIssue=false

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support.drives import exact, observed, round_trip, sighted
from support.rooms import furnished

from edgemap.geometry.camera.attitude import Attitude, MountEstimate
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.grid.patch import Patch
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.motion.height_check import HeightCheck, HeightRule
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.outputs.sinks.rewriting import rewrite
from edgemap.runtime.step.mapper import Mapper

ROOM = furnished(np.random.default_rng(5), 12, apart_m=1.5)
POSES = round_trip(200, turns=1.8)
FACTOR = 1.25


def frames():
    """What a front end with the true height observes of each frame."""
    random = np.random.default_rng(3)
    for index, (pose, motion) in enumerate(zip(POSES, exact(POSES), strict=True)):
        noisy = replace(motion, covariance=np.eye(3) * 1e-5)
        yield observed(index, sighted(ROOM, pose, index, random), noisy)


def mapped(mapper, changes_at=None):
    """The map by a height that is FACTOR too low until a frame, None for the true one; and the last update."""
    update = None
    for index, seen in enumerate(frames()):
        if changes_at is not None:
            seen = replace(seen.scaled(1.0 / FACTOR), scale=FACTOR if index >= changes_at else 1.0)
        update = mapper.step(mapper.in_scale(seen))
    return update, mapper.objects()


@pytest.mark.parametrize("changes_at", [1, 120, 190])
def test_the_map_is_that_of_the_right_height_whenever_it_is_found(changes_at):
    right, expected = mapped(Mapper(closes_loops=True))
    update, found = mapped(mapper := Mapper(closes_loops=True), changes_at)
    assert mapper.scale == FACTOR
    assert [item.label for item in found] == [item.label for item in expected]
    for item, like in zip(found, expected, strict=True):
        assert item.position_m == pytest.approx(like.position_m, abs=0.04)
        assert (item.width_m, item.height_m) == pytest.approx((like.width_m, like.height_m))
        assert np.sqrt(np.diag(item.covariance_m2)) == pytest.approx(np.sqrt(np.diag(like.covariance_m2)), rel=0.25)
    assert update.pose_map_base.vector() == pytest.approx(right.pose_map_base.vector(), abs=0.02)
    assert update.travelled_m == pytest.approx(right.travelled_m, rel=0.02)
    stamps = np.arange(200) / 10
    assert update.trajectory.at(stamps) == pytest.approx(right.trajectory.at(stamps), abs=0.02)
    # REP-105: the pose by odometry alone never jumps.
    assert update.pose_odom_base.x_m == pytest.approx(right.pose_odom_base.x_m, abs=1.0)


def test_sightings_of_before_are_written_again_at_the_new_scale():
    update, _ = mapped(Mapper(), 120)
    assert update.trajectory.scale_since([0.0, 11.9, 12.0]) == pytest.approx([FACTOR, FACTOR, 1.0])


def test_a_run_folders_sightings_state_the_scale_they_took_however_often_they_are_written(tmp_path):
    update, _ = mapped(Mapper(), 120)
    trajectory, sightings = tmp_path / "trajectory.tum", tmp_path / "sightings.jsonl"
    stamps = [11.9, 12.0]
    trajectory.write_text("".join(tum_line(at, SE2(*update.trajectory.at([at])[0])) for at in stamps))
    lengths = {"base_m": [2.0, 1.0], "map_m": [0.0, 0.0], "distance_m": 2.2, "width_m": 0.4, "height_m": 0.8}
    sightings.write_text("".join(json.dumps({"stamp_s": at} | lengths) + "\n" for at in stamps))
    for _ in range(2):
        rewrite(trajectory, sightings, update.trajectory)
        before, after = map(json.loads, sightings.read_text().splitlines())
        assert (before["base_m"], before["scale"]) == ([2.5, 1.25], FACTOR)
        assert (before["distance_m"], before["width_m"], before["height_m"]) == (2.75, 0.5, 1.0)
        place = SE2(*update.trajectory.at([11.9])[0]).apply(np.array([2.5, 1.25]))
        assert before["map_m"] == pytest.approx(place.tolist(), abs=1e-3)
        assert {name: after[name] for name in lengths if name != "map_m"} == {
            name: value for name, value in lengths.items() if name != "map_m"
        }
        assert "scale" not in after


def test_edits_keep_their_place_among_the_objects():
    mapper = Mapper()
    first, *rest = frames()
    mapper.step(mapper.in_scale(first))
    mapper.edit(Edit("zone", name="rug", corners_m=((1.0, 0.0), (2.0, 0.0), (2.0, 1.0))))
    mapper.edit(Edit("dock", pose=(0.4, -0.2, 1.0)))
    added = mapper.edit(Edit("add", label="chair", place_m=(2.0, 2.0), size_m=(0.4, 0.5, 0.9)))
    mapper.step(mapper.in_scale(replace(rest[0], scale=FACTOR)))
    (zone,), dock = mapper.annotations().zones, mapper.annotations().dock
    assert np.array(zone.corners_m) == pytest.approx(FACTOR * np.array([(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)]))
    assert dock == SE2(FACTOR * 0.4, -FACTOR * 0.2, 1.0)
    (chair,) = (item for item in mapper.objects() if item.id == added)
    assert chair.position_m == pytest.approx([FACTOR * 2.0, FACTOR * 2.0])
    assert (chair.width_m, chair.height_m) == (0.4, 0.9)  # which a person has measured


def test_after_a_pose_by_a_person_the_scale_stays():
    """The objects so far are as those of a saved map then, with a scale of their own."""
    mapper, (first, second, third, *_) = Mapper(), frames()
    mapper.step(mapper.in_scale(first))
    mapper.step(mapper.in_scale(replace(second, scale=FACTOR)))
    before = [item.position_m.tolist() for item in mapper.objects()]
    mapper.edit(Edit("pose", pose=(0.5, 0.0, 0.0)))
    seen = mapper.in_scale(replace(third, scale=2.0 * FACTOR))
    assert seen.motion.motion == third.motion.motion.scaled(FACTOR)
    assert mapper.scale == FACTOR
    assert [item.position_m.tolist() for item in mapper.objects()] == before


def test_a_motion_without_pictures_takes_the_new_scale_too():
    mapper, (first, second, *_) = Mapper(), frames()
    mapper.step(mapper.in_scale(first))
    mapper.step_blind(Motion(SE2(0.4, 0.1, 0.2), np.eye(3) * 1e-4))
    update = mapper.step(mapper.in_scale(replace(second, sightings=[], motion=Motion(SE2()), scale=FACTOR)))
    assert update.pose_map_base.vector() == pytest.approx([0.4 * FACTOR, 0.1 * FACTOR, 0.2])


def test_the_camera_at_another_scale_sees_the_floor_where_its_objects_are():
    """With its lever arm, as positions are scaled about the base."""
    camera, pixels = FloorCamera(LENS, Mount(0.6, 0.2, 0.05, forward_m=0.2, left_m=-0.1)), [(100.0, 300.0), (500, 400)]
    (seen, *_) = frames()
    scaled = replace(seen, camera=camera).scaled(FACTOR).camera
    assert scaled is not None
    assert scaled.floor_points(pixels) == pytest.approx(FACTOR * camera.floor_points(pixels))


def test_a_saved_map_and_the_papers_keep_their_scale():
    saved = [MapObject("chair-1", "chair", np.array([2.0, 1.0]), np.eye(2) * 0.01, 0.5, 0.9, 9, 0.9, 0.0, 1.0)]
    continued, paper = Mapper(), Mapper(paper=PaperMap())
    continued.start_in(saved, SE2())
    for mapper in (continued, paper):
        seen = mapper.in_scale(replace(next(frames()), scale=FACTOR))
        assert (mapper.scale, seen.scale) == (1.0, 1.0)


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.3])
def test_evidence_of_the_grid_has_no_holes_at_another_scale(factor):
    cells = np.stack(np.meshgrid(np.arange(-8, 12), np.arange(3, 9)), axis=-1).reshape(-1, 2).astype(np.int32)
    values = np.arange(len(cells)).astype(np.int16)
    patch = Patch(1.0, SE2(), cells, values, values, values, SE2(1.0, 2.0, 0.5)).scaled(factor)
    assert patch.move == SE2(factor, 2.0 * factor, 0.5)
    at = {tuple(cell): value for cell, value in zip(cells.tolist(), values.tolist(), strict=True)}
    assert len(patch) == pytest.approx(len(cells) * factor**2, rel=0.1)
    for cell, value in zip(patch.cells.tolist(), patch.shift.tolist(), strict=True):
        assert at[tuple(np.floor((np.array(cell) + 0.5) / factor).astype(int).tolist())] == value


def test_many_changes_of_scale_round_the_grid_no_more_than_one():
    """A wall five metres away, after twenty estimates of the height that end at the first one."""
    cells = np.stack(np.meshgrid(np.arange(90, 110), np.arange(-9, 9)), axis=-1).reshape(-1, 2).astype(np.int32)
    values = np.where(cells[:, 0] == 100, 500, -300).astype(np.int16)
    first = patch = Patch(1.0, SE2(), cells, values, values, values, SE2(1.0, 0.0, 0.0))
    scale = 1.0
    for after in (*np.random.default_rng(2).uniform(0.9, 1.1, 20).tolist(), 1.0):
        patch, scale = patch.scaled(after / scale), after
    for found, expected in ((patch.cells, cells), (patch.shift[:, None], values[:, None])):
        order, own = np.lexsort(patch.cells.T), np.lexsort(first.cells.T)
        assert (found[order] == expected[own]).all()
    assert patch.move.vector() == pytest.approx(first.move.vector())


LENS = Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5)


def chairs(mount):
    """Boxes of chairs of usual size, seen by a camera on this mount."""
    camera, boxes = FloorCamera(LENS, mount), []
    for x, y in ((2.2, 0.3), (3.0, -0.6)):
        corners = [(x + a, y + b, z) for a in (0.0, 0.5) for b in (-0.25, 0.25) for z in (0.0, 0.85)]
        pixels = camera.project(corners) + 0.5
        boxes.append(np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]))
    return Detections(np.array(boxes), np.full(2, 0.9), np.zeros(2, np.int64), ("chair",))


@pytest.mark.parametrize("guessed", [0.0, 0.3])
def test_a_guess_moves_to_the_sizes_of_objects_and_a_given_height_never(guessed):
    """Lens 0.6 m up, taken for 0.72: the sizes (13 %) weigh five times as much as a guess of 30 %."""
    mount = Mount(0.72, 0.1)
    check, boxes = HeightCheck(mount, guessed=guessed), chairs(Mount(0.6, 0.1))
    for index in range(200):
        fault = check.judge(index / 10, FloorCamera(LENS, mount), Attitude.of_mount(mount), boxes, Motion())
        assert not fault
    assert check.scale == (pytest.approx(0.6 / 0.72, abs=0.04) if guessed else 1.0)
    assert check.estimate is not None
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_wheels_measure_the_path_so_its_scale_stays():
    mount, boxes = Mount(0.72, 0.1), chairs(Mount(0.6, 0.1))
    check = HeightCheck(mount, HeightRule(), 0.3)
    for index in range(200):
        motion = Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-6, lengths=(0.06, 0.05))
        check.judge(index / 10, FloorCamera(LENS, mount), Attitude.of_mount(mount), boxes, motion)
    assert check.scale == 1.0
    assert check.estimate is not None
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.02)


@pytest.mark.parametrize("measures", [{"depth": True}, {"motion": Motion(lengths=(0.0, 0.0))}])
@pytest.mark.parametrize("begins", [0, 150])
def test_a_robot_that_turns_in_place_has_wheels_or_depth_all_the_same(measures, begins):
    """The path is measured from then on, whatever the sizes have shown: 50 cm rolled are not waited for."""
    mount, boxes = Mount(0.72, 0.1), chairs(Mount(0.6, 0.1))
    check, usual = HeightCheck(mount, HeightRule(), 0.3), {"motion": Motion()}
    for index in range(200):
        given = usual | measures if index >= begins else usual
        check.judge(index / 10, FloorCamera(LENS, mount), Attitude.of_mount(mount), boxes, **given)
        assert (check.scale == 1.0) == (index < 100 or index >= begins)
    assert check.estimate is not None
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_a_correction_of_the_mount_keeps_the_sizes_of_a_guess():
    """Pitch 3 degrees too steep for 20 s, then right, and no box more: the boxes so far give the scale by the right
    pitch. A given height is judged by boxes after the correction alone."""
    mount, boxes = Mount(0.72, 0.1 + math.radians(3.0)), chairs(Mount(0.6, 0.1))
    right = replace(mount, pitch_rad=0.1)
    estimate = MountEstimate(right, np.full(2, 0.005), right, mount)
    corrected = replace(Attitude.of_mount(right), mount=estimate)
    for guessed in (0.3, 0.0):
        check = HeightCheck(mount, guessed=guessed)
        for index in range(200):
            check.judge(index / 10, FloorCamera(LENS, mount), Attitude.of_mount(mount), boxes, Motion())
        wrong = check.estimate
        assert wrong is not None
        assert wrong.height_m > 0.66
        for index in range(200, 400):
            check.judge(index / 10, FloorCamera(LENS, right), corrected, Detections.none(("chair",)), Motion())
        if guessed:
            assert check.scale == pytest.approx(0.6 / 0.72, abs=0.04)
            assert check.estimate is not None
            assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)
        else:
            assert check.estimate is wrong
