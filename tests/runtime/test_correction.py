import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.drifting import drifting, integrated, sighted, worst_m
from support.drives import round_trip
from support.rooms import furnished

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.runtime.frame import Frame
from edgemap.runtime.loop_closing import LoopCloser, NoLoopClosure
from edgemap.runtime.pipeline import StepResult
from edgemap.runtime.relocalisation import START_SIGMAS
from edgemap.runtime.report.history import History
from edgemap.runtime.sinks.run_folder import RunFolder
from edgemap.runtime.trajectory import read_tum
from edgemap.view.page import LivePage

ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)
WAY = round_trip(260, turns=2.4)


def steps(loop_closer, way=WAY, room=ROOM, seed=0, **drift):
    """Results and maps of a drive, made as the pipeline makes them, without pictures."""
    random, floor_map = np.random.default_rng(seed), FloorMap()
    pose, covariance = SE2(), np.zeros((3, 3))
    for index, motion in enumerate(drifting(way, seed, **drift)):
        if index:
            covariance = compose_covariance(pose, covariance, motion.motion, motion.covariance)
            pose = pose @ motion.motion
        sightings = sighted(room, way[index], index, random)
        corrected = loop_closer.look(pose, covariance, motion, sightings, index / 10)
        if corrected is not None:
            pose, covariance = corrected.pose_map_base, corrected.pose_covariance
            floor_map.moved(corrected.things)
        placed = [
            sighting.placed(pose, covariance, thing)
            for sighting, thing in zip(sightings, loop_closer.things, strict=True)
        ]
        ids = floor_map.update(placed)
        frame = Frame(index, index / 10, np.zeros((2, 2, 3), np.uint8))
        count = len(placed)
        found = Detections(np.zeros((count, 4)), np.full(count, 0.8), np.zeros(count, dtype=np.int64), ("thing",))
        result = StepResult(
            frame, found, placed, ids, floor_map.merged, motion, pose, covariance, {}, corrected=corrected
        )
        yield result, floor_map.objects()


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
    return list(steps(LoopCloser()))


def test_a_loop_leaves_no_double_and_everything_in_its_place(corrected):
    drifted, doubles = errors_m(list(steps(NoLoopClosure()))[-1][1])
    assert doubles > 3  # or this drive shows nothing
    true_map = list(steps(NoLoopClosure(), yaw_share=0.0, way_share=0.0))[-1][1]
    right, left = errors_m(corrected[-1][1])
    assert left == 0
    assert len(right) == len(true_map)
    assert np.median(right) < 0.4 * np.median(drifted)


def test_the_pose_of_the_moment_is_put_right(corrected):
    alone = integrated(drifting(WAY))
    start, end = WAY[0].inverse(), corrected[-1][0].pose_map_base
    truth = start @ WAY[-1]
    assert np.hypot(end.x_m - truth.x_m, end.y_m - truth.y_m) < 0.25
    assert np.hypot(alone[-1].x_m - truth.x_m, alone[-1].y_m - truth.y_m) > 0.6


def test_the_covariance_is_honest_after_a_loop(corrected):
    result = corrected[-1][0]
    off = result.pose_map_base.vector() - (WAY[0].inverse() @ WAY[-1]).vector()
    off[2] = np.angle(np.exp(1j * off[2]))
    assert off @ np.linalg.solve(result.pose_covariance, off) < 16.3  # chi-square, 3 degrees of freedom, 99.9 %


def test_the_run_folder_is_written_anew_as_known_at_the_end(corrected, tmp_path):
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount

    floor = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))
    folder = RunFolder(tmp_path / "run", floor, {})
    for result, objects in corrected:
        folder.write(result, objects)
    at_the_time = [result.pose_map_base for result, _ in corrected]
    folder.close()
    written = read_tum(tmp_path / "run" / "trajectory.tum")
    assert len(written.poses) == len(WAY)
    assert worst_m(written.poses, WAY) < 0.5 * worst_m(at_the_time, WAY)
    last = written.poses[-1].vector()
    assert last == pytest.approx(at_the_time[-1].vector(), abs=1e-6)
    record = json.loads((tmp_path / "run" / "run.json").read_text())["corrections"]
    times = [result.corrected for result, _ in corrected if result.corrected]
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
    way = history.way()
    assert worst_m([stop.pose_map_base for stop in way], WAY) < 0.6 * worst_m(integrated(drifting(WAY)), WAY)
    driven = sum(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in pairwise(WAY))
    assert history.way_m == pytest.approx(driven, rel=0.05)  # a correction is no way driven
    trail, _ = page.trail.since(0, 9999)
    start = WAY[0].inverse()
    true = np.array([(p.x_m, p.y_m) for p in (start @ pose for pose in WAY)])
    off = [np.linalg.norm(true - place, axis=1).min() for place in trail]
    assert max(off) < 0.35
    assert page.epoch > 0


def test_a_start_told_roughly_is_put_right_by_the_saved_maps_things():
    saved = list(steps(NoLoopClosure(), yaw_share=0.0, way_share=0.0))[-1][1]
    told = SE2(0.15, -0.1, 0.06)  # the robot stands at the origin
    loop_closer, random, pose = LoopCloser(), np.random.default_rng(5), told
    loop_closer.begin_in(saved)
    covariance = np.diag(np.square(START_SIGMAS))
    for index, motion in enumerate(drifting(WAY[:120], 5, yaw_share=0.01)):
        pose = pose @ motion.motion if index else pose
        sightings = sighted(ROOM, WAY[index], index, random)
        corrected = loop_closer.look(pose, covariance, motion, sightings, index / 10)
        pose = corrected.pose_map_base if corrected else pose
    truth = WAY[0].inverse() @ WAY[119]
    off = truth.inverse() @ pose
    assert np.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.yaw_rad) < 0.03


def test_a_way_put_right_in_the_step_that_finds_the_saved_map_moves_before_it_turns(corrected, tmp_path):
    """First the past moves in the run's own frame, then all of it into the saved map's."""
    first = next(row for row, (result, _) in enumerate(corrected) if result.corrected)
    turn = SE2(4.0, 1.0, 1.5)
    history = History()
    for result, _ in corrected[:first]:
        history.add(result)
    told = history.way()[0].pose_map_base, history.way()[-1]
    result = corrected[first][0]
    assert result.corrected is not None
    history.add(replace(result, relocated=turn, pose_map_base=turn @ result.pose_map_base))
    way = history.way()
    assert way[0].pose_map_base.vector() == pytest.approx((turn @ told[0]).vector(), abs=1e-9)
    before = result.corrected.moved(told[1].stamp_s, told[1].pose_map_base)
    assert way[-2].pose_map_base.vector() == pytest.approx((turn @ before).vector(), abs=1e-9)
    assert history.way_m < 1.1 * 0.1 * first
