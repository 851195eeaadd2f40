"""Loop closure: everything in its place, an honest covariance, no wrong hypothesis that moves the pose, and the poses
of a long drive in bounded memory; chains of tf."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.drifting import drifting, integrated, worst_m
from support.drives import drive, observed, round_trip
from support.painted import FLOOR
from support.rooms import ROOM, furnished

from edgemap.bridges.ros2.messages.tf_tree import TfTree
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam import loop_closure
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.outputs import sightings_file
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step import pose_journal
from edgemap.runtime.step.map_file import load_map, save_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.relocalisation import SavedMap
from edgemap.view.page import LivePage
from edgemap.view.report.history import History

WAY = round_trip(260, turns=2.4)


def steps(closes_loops, way=WAY, room=ROOM, seed=0, **drift):
    """Results and maps of a drive."""
    return drive(Mapper(closes_loops=closes_loops), room, way, drifting(way, seed, **drift), seed)


def errors_m(objects):
    """Distance of each mapped object from the nearest thing of its label; how many things are mapped twice."""
    start, nearest, taken = WAY[0].inverse(), [], []
    for item in objects:
        places = [(start.apply([x, y]), row) for row, (label, x, y) in enumerate(ROOM) if label == item.label]
        far, row = min((float(np.linalg.norm(item.position_m - place)), row) for place, row in places)
        nearest.append(far)
        taken.append(row)
    return nearest, len(taken) - len(set(taken))


@pytest.fixture(scope="module")
def corrected():
    return list(steps(True))


def test_a_loop_leaves_no_double_and_everything_in_its_place(corrected):
    drifted, doubles = errors_m(list(steps(False))[-1][1])
    assert doubles > 3  # or this drive shows nothing
    true_map = list(steps(False, yaw_share=0.0, way_share=0.0))[-1][1]
    right, left = errors_m(corrected[-1][1])
    assert left == 0
    assert len(right) == len(true_map)
    assert np.median(right) < 0.4 * np.median(drifted)


def test_the_covariance_is_honest_after_a_loop(corrected):
    result = corrected[-1][0]
    off = result.pose_map_base.vector() - (WAY[0].inverse() @ WAY[-1]).vector()
    off[2] = np.angle(np.exp(1j * off[2]))
    assert off @ np.linalg.solve(result.pose_covariance, off) < 16.3  # chi-square, 3 degrees of freedom, 99.9 %
    assert np.sqrt(np.trace(result.pose_covariance[:2, :2])) < 0.15  # a quarter of what odometry alone is off; 0.10


def test_a_correction_states_how_far_it_moves_the_pose(corrected):
    for (before, _), (result, _) in pairwise(corrected):
        if result.correction:
            expected, found = before.pose_map_base @ result.observed.motion.motion, result.pose_map_base
            off_m = np.hypot(found.x_m - expected.x_m, found.y_m - expected.y_m)
            assert result.correction.moved_m == pytest.approx(off_m, abs=1e-9)


def test_a_loop_and_another_path_that_come_in_one_frame_both_move_the_trajectory(corrected):
    count = 1 + next(row for row, (result, _) in enumerate(corrected) if result.correction)
    motions = drifting(WAY)[:count]
    motions[-1] = replace(motions[-1], instead=lambda stamp_s: WAY[round(10 * stamp_s)])
    *_, (result, _) = drive(Mapper(closes_loops=True), ROOM, WAY[:count], motions)
    assert worst_m([SE2(*pose) for pose in result.trajectory.at(np.arange(count) / 10)], WAY[:count]) < 0.02


def test_the_run_folder_is_written_anew_as_known_at_the_end(corrected, tmp_path):
    folder = RunFolder(tmp_path / "run", FLOOR, {})
    for result, objects in corrected:
        folder.write(result, objects)
    at_the_time = [result.pose_map_base for result, _ in corrected]
    folder.close()
    written = trajectory_of(tmp_path / "run" / "trajectory.tum")
    assert len(written.poses) == len(WAY)
    assert worst_m(written.poses, WAY) < 0.5 * worst_m(at_the_time, WAY)
    last = written.poses[-1].vector()
    assert last == pytest.approx(at_the_time[-1].vector(), abs=1e-6)
    record = json.loads((tmp_path / "run" / "run.json").read_text())["corrections"]
    times = [result.correction for result, _ in corrected if result.correction]
    assert record["count"] == len(times)
    assert record["largest_m"] == pytest.approx(max(item.moved_m for item in times), abs=1e-3)
    assert record["seen_again"] == times[-1].links > 5
    # The sightings moved with it: they lie where the map has their objects.
    merged = corrected[-1][0].merged
    places = {item.id: item.position_m for item in corrected[-1][1]}
    far = [
        float(np.linalg.norm(places[merged.get(seen["object"], seen["object"])] - seen["map_m"]))
        for seen in map(json.loads, (tmp_path / "run" / "sightings.jsonl").read_text().splitlines())
        if merged.get(seen["object"], seen["object"]) in places
    ]
    assert np.percentile(far, 95) < 0.3


def test_report_and_page_tell_the_way_as_it_is_known_now(corrected, tmp_path):
    history, page = History(), LivePage({}, tmp_path)
    for result, objects in corrected:
        history.add(result)
        page.write(result, objects)
    way = [SE2(x_m, y_m) for x_m, y_m, *_ in history.trail()]
    assert worst_m(way, WAY) < 0.6 * worst_m(integrated(drifting(WAY)), WAY)
    driven = sum(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in pairwise(WAY))
    assert corrected[-1][0].travelled_m == pytest.approx(driven, rel=0.05)  # a correction is no way driven
    trail, _ = page.trail.since(0, 9999)
    start = WAY[0].inverse()
    true = np.array([(p.x_m, p.y_m) for p in (start @ pose for pose in WAY)])
    off = [np.linalg.norm(true - place[:2], axis=1).min() for place in trail]
    assert max(off) < 0.35
    assert page.epoch > 0


def test_a_start_told_roughly_is_corrected_by_the_saved_maps_objects():
    """A saved map holds nothing that is not there: an object that it has seen once counts as well."""
    saved = [replace(item, count=1) for item in list(steps(False, yaw_share=0.0, way_share=0.0))[-1][1]]
    mapper, way = Mapper(closes_loops=True), WAY[:120]
    mapper.start_in(SavedMap(saved), SE2(0.15, -0.1, 0.06))  # the robot stands at the origin
    *_, (result, _) = drive(mapper, ROOM, way, drifting(way, 5, yaw_share=0.01, way_share=0.01), 5)
    off = (WAY[0].inverse() @ WAY[119]).inverse() @ result.pose_map_base
    assert np.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.yaw_rad) < 0.045  # of 0.06; the view ahead says little of yaw


def test_a_second_visit_the_other_way_round_leaves_no_twins(corrected, tmp_path):
    """Over the saved map, with odometry that drifts and no start pose: nothing twice, and no object's place worse."""
    save_map(tmp_path / "map.json", corrected[-1][1])
    saved = load_map(tmp_path / "map.json")
    mapper, back = Mapper(closes_loops=True), WAY[::-1]
    mapper.relocalise_in(SavedMap(saved))
    relocated = [result.relocated for result, _ in drive(mapper, ROOM, back, drifting(back, 8), 8)]
    assert sum(pose is not None for pose in relocated) == 1
    first, second = errors_m(saved), errors_m(mapper.objects())
    assert second[1] == 0
    assert len(second[0]) == len(first[0])
    assert np.median(second[0]) < np.median(first[0]) + 0.03
    assert {item.id for item in saved} == {item.id for item in mapper.objects()}


def test_a_correction_in_the_step_that_finds_the_saved_map_moves_the_past_before_it_turns():
    """First the past moves in the run's own frame, then all of it into the saved map's."""
    turn, journal = SE2(4.0, 1.0, 1.5), PoseJournal()
    told = [SE2(0.1 * k, 0.0, 0.0) for k in range(4)]
    for index, pose in enumerate(told):
        journal.append(float(index), pose)
    moves = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    journal.correct(TrajectoryCorrection(np.array([0.0, 2.0]), moves))
    journal.transform(turn)
    journal.append(4.0, turn @ SE2(0.4, 0.5, 0.0))
    now = journal.at([0.0, 1.0, 2.0, 3.0, 4.0])
    true = [*told[:2], SE2(0.2, 0.5, 0.0), SE2(0.3, 0.5, 0.0), SE2(0.4, 0.5, 0.0)]
    np.testing.assert_allclose(now, [(turn @ pose).vector() for pose in true], atol=1e-12)


SIGMAS = np.array([0.002, 0.002, 0.002])  # m, m, rad, of one motion: as stated, and as it is


def odometry(way, random):
    """Motions with the errors that their covariance states."""
    motions = [Motion()]
    for before, now in pairwise(way):
        noise = SE2(*random.normal(0.0, SIGMAS))
        motions.append(Motion(before.inverse() @ now @ noise, np.diag(SIGMAS**2)))
    return motions


def low_lens(room, pose, index, random, errors, height_m=0.19):
    """What a lens near the floor sees: a lower edge that is 3 pixels off all along a visit is decimetres of range."""
    seen = []
    for row, (label, x, y) in enumerate(room):
        place = pose.inverse().apply([x, y])
        far = float(np.hypot(*place))
        if not (0.6 < far < 3.5 and abs(math.atan2(place[1], place[0])) < 0.6):
            errors.pop(row, None)
            continue
        across, sigma_m = 0.05, 3.0 * far**2 / (height_m * 500.0)
        error = errors.setdefault(row, random.normal(0.0, 0.8)) + random.normal(0.0, 0.5)
        ray = place / far
        side = np.array([-ray[1], ray[0]])
        at = place + ray * error * sigma_m + side * random.normal(0.0, across)
        own, count = np.outer(ray, ray) * sigma_m**2 + np.outer(side, side) * across**2, len(seen)
        seen.append(Sighting(label, 0.8, at, own, np.eye(2) * 1e-4, 0.5, 0.9, 0.5, far, count, index, index / 10))
    return seen


def drift_m(way, motions, sightings, closes_loops):
    """Greatest distance of the mapper's poses from the true ones; the updates."""
    mapper, updates, start, far_m = Mapper(closes_loops=closes_loops), [], way[0].inverse(), 0.0
    for index, (motion, seen) in enumerate(zip(motions, sightings, strict=True)):
        updates.append(mapper.step(observed(index, seen, motion)))
        pose, true = updates[-1].pose_map_base, start @ way[index]
        far_m = max(far_m, math.hypot(pose.x_m - true.x_m, pose.y_m - true.y_m))
    return far_m, updates


@pytest.mark.parametrize("seed", range(4))
def test_ranges_that_err_together_do_not_bend_a_trajectory_that_is_right(seed):
    """As in home 9001: odometry good to centimetres, a low lens whose ranges err by decimetres from each side. Right
    landmarks found again must not move the pose by more than odometry leaves open."""
    random, errors = np.random.default_rng(seed), dict[int, float]()
    room, way = furnished(random, 16, apart_m=0.8), round_trip(260, turns=2.4)
    motions = odometry(way, random)
    sightings = [low_lens(room, pose, index, random, errors) for index, pose in enumerate(way)]
    alone_m, _ = drift_m(way, motions, sightings, False)
    closed_m, updates = drift_m(way, motions, sightings, True)
    corrections = [update.correction for update in updates if update.correction]
    assert corrections
    assert corrections[-1].links > 3  # or this drive shows nothing
    assert closed_m < alone_m + 0.05
    sigma_m = [np.sqrt(np.trace(update.pose_covariance[:2, :2])) for update in updates]
    for index, update in enumerate(updates):
        if update.correction:  # to close a loop is to know more
            step_m = np.sqrt(np.trace(motions[index].covariance[:2, :2])) + 0.002
            assert sigma_m[index] < 1.03 * sigma_m[index - 1] + step_m


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.6, 2.0), st.integers(1, 3))
def test_false_hypotheses_never_move_the_pose_beyond_what_odometry_leaves_open(seed, apart_m, links):
    """Whatever is proposed as one object, up to three pairs at a time a metre or so apart: the pose stays within four
    standard deviations of where odometry alone has it."""
    random = np.random.default_rng(seed)

    def wrong(pairings, landmarks, *others):
        yield
        far_m = [float(np.linalg.norm(landmarks[now] - landmarks[before])) for now, before in pairings]
        found = {pair[0]: pair for pair, m in zip(pairings, far_m, strict=True) if abs(m - apart_m) < 0.4}
        return list({pair[1]: pair for pair in found.values()}.values())[:links]

    room, way = furnished(random, 14, apart_m=0.8), round_trip(130, turns=1.6)
    motions, errors = odometry(way, random), dict[int, float]()
    sightings = [low_lens(room, pose, index, random, errors, 0.8) for index, pose in enumerate(way)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop_closure, "certain_pairings", wrong)
        _, updates = drift_m(way, motions, sightings, True)
    for update in updates:
        off = update.pose_odom_base.vector() - update.pose_map_base.vector()
        off[2] = math.remainder(off[2], math.tau)
        sigmas = np.sqrt(np.diagonal(update.odom_covariance)) + 1e-3
        assert (np.abs(off) < 4.0 * sigmas).all()


def told(folder):
    """Poses (N, 3) of the trajectory file, and each sighting's place (N, 2)."""
    seen = [json.loads(line)["map_m"] for line in (folder / "sightings.jsonl").read_text().splitlines()]
    return np.array([pose.vector() for pose in trajectory_of(folder / "trajectory.tum").poses]), np.array(seen)


def test_a_long_drive_keeps_few_poses_and_its_files_are_as_known_now(monkeypatch, tmp_path):
    """The same drive with all of its poses in memory, and with fewer than half of them."""
    way, files = round_trip(400, turns=3), {}
    for maximum in (pose_journal.MAXIMUM, 200):
        poses: list[SE2] = []
        monkeypatch.setattr(pose_journal, "MAXIMUM", maximum)
        monkeypatch.setattr(sightings_file, "BLOCK", 4096 if maximum > 200 else 50)
        mapper, folder = Mapper(closes_loops=True), RunFolder(tmp_path / str(maximum), FLOOR, {})
        for result, objects in drive(mapper, ROOM, way, drifting(way), 0):
            folder.write(result, objects)
            poses.append(result.pose_map_base)
            assert len(mapper.trajectory) <= maximum
        at_the_time = np.array([pose.vector() for pose in poses])
        folder.close()
        files[maximum] = told(folder.folder)
        assert mapper.trajectory.revision > 3
    assert len(files[200][0]) == 400
    off_m = [np.linalg.norm((few - every)[:, :2], axis=1) for every, few in zip(*files.values(), strict=True)]
    moved_m = np.linalg.norm((at_the_time - files[200][0])[:, :2], axis=1)
    assert moved_m.max() > 0.3
    for off in off_m:  # where a correction fell between a kept pose and one that follows it, by that correction's size
        assert np.median(off) < 1e-3
        assert np.percentile(off, 90) < 0.2 * moved_m.max()


def test_a_stamp_that_a_file_has_rounded_down_is_still_that_poses():
    journal, stamps = PoseJournal(), [1.7e9 + k / 3 for k in range(10)]
    for k, stamp_s in enumerate(stamps):
        journal.append(stamp_s, SE2(float(k), 0.0, 0.0))
    written = [float(f"{stamp_s - 3e-7:.6f}") for stamp_s in stamps]
    assert journal.at(written)[:, 0] == pytest.approx(range(10))


def test_a_correction_counts_from_the_next_question_on():
    journal = PoseJournal()
    for k in range(4):
        journal.append(float(k), SE2(float(k), 0.0, 0.0))
    move = np.array([[2.0, 0.0, 0.0]])
    journal.correct(TrajectoryCorrection(np.array([0.0]), move))
    journal.append(4.0, SE2(9.0, 0.0, 0.0))
    assert journal.stamps_near([[2.1, 0.0], [9.1, 0.0]]).tolist() == [0.0, 4.0]


def matrix(position_m, rpy_deg):
    """Homogeneous, (4, 4)."""
    rotation = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    return np.vstack([np.column_stack([rotation, position_m]), [0.0, 0.0, 0.0, 1.0]])


def test_a_chain_of_rotations_about_different_axes_is_their_product():
    """The camera on an arm on the base, and a lidar on the base: rotations of a chain do not commute."""
    pytest.importorskip("rosbags")
    from support.ros_bag import tf, transform

    arm, camera = ((0.1, 0.2, 0.3), (0, 0, 40)), ((0.0, 0.5, -0.1), (-90, 10, -90))
    lidar = (-0.3, 0.0, 0.4), (0, 25, 0)
    tree = TfTree("bag")
    links = transform("base", "arm", *arm), transform("arm", "camera", *camera), transform("/base", "lidar", *lidar)
    tree.add(tf(*links))
    base_camera = matrix(*arm) @ matrix(*camera)
    for parent, expected in (("base", base_camera), ("lidar", np.linalg.inv(matrix(*lidar)) @ base_camera)):
        np.testing.assert_allclose(tree.pose(parent, "camera"), expected, atol=1e-12)
    assert tree.pose("base", "gripper") is None
