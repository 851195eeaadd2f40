"""The poses of a long drive in bounded memory, and what of them a run folder tells."""

import json

import numpy as np
import pytest
from support.drifting import drifting
from support.drives import drive, round_trip
from support.rooms import furnished
from support.tum import read_tum

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.outputs.sinks import rewriting
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step import pose_journal
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pose_journal import PoseJournal

ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)
FLOOR = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))


def told(folder):
    """Poses (N, 3) of the trajectory file, and each sighting's place (N, 2)."""
    seen = [json.loads(line)["map_m"] for line in (folder / "sightings.jsonl").read_text().splitlines()]
    return np.array([pose.vector() for pose in read_tum(folder / "trajectory.tum").poses]), np.array(seen)


def test_a_long_drive_keeps_few_poses_and_its_files_are_as_known_now(monkeypatch, tmp_path):
    """The same drive with all of its poses in memory, and with fewer than half of them."""
    way, files = round_trip(400, turns=3), {}
    for maximum in (pose_journal.MAXIMUM, 200):
        poses: list[SE2] = []
        monkeypatch.setattr(pose_journal, "MAXIMUM", maximum)
        monkeypatch.setattr(rewriting, "BLOCK", 4096 if maximum > 200 else 50)
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
    moved = TrajectoryCorrection(np.array([0.0]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3, 3)))
    journal.correct(moved)
    assert journal.at([0.0, 1.0, 2.0, 3.0])[:, 0] == pytest.approx([1.0, 2.0, 3.0, 4.0])
    journal.correct(moved)
    journal.append(4.0, SE2(9.0, 0.0, 0.0))
    assert journal.stamps_near([[2.1, 0.0], [9.1, 0.0]]).tolist() == [0.0, 4.0]
