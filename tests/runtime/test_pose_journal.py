"""The poses of a long drive in bounded memory, what of them a run folder tells, and chains of tf."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.drifting import drifting
from support.drives import drive, round_trip
from support.painted import FLOOR
from support.rooms import furnished
from support.tum import read_tum

from edgemap.bridges.ros2.messages.tf_tree import TfTree
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.outputs.sinks import rewriting
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step import pose_journal
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pose_journal import PoseJournal

ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)


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
    journal.correct(
        TrajectoryCorrection(np.array([0.0]), np.array([[2.0, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3, 3)))
    )
    journal.append(4.0, SE2(9.0, 0.0, 0.0))
    assert journal.stamps_near([[2.1, 0.0], [9.1, 0.0]]).tolist() == [0.0, 4.0]


def transform(parent, child, rotation, position_m):
    """One transform of a `tf2_msgs/TFMessage`."""
    quaternion = SimpleNamespace(**dict(zip("xyzw", rotation.as_quat(), strict=True)))
    moved = SimpleNamespace(**dict(zip("xyz", position_m, strict=True)))
    value = SimpleNamespace(rotation=quaternion, translation=moved)
    return SimpleNamespace(header=SimpleNamespace(frame_id=parent), child_frame_id=child, transform=value)


def matrix(rotation, position_m):
    """Homogeneous, (4, 4)."""
    return np.vstack([np.column_stack([rotation.as_matrix(), position_m]), [0.0, 0.0, 0.0, 1.0]])


def test_a_chain_of_rotations_about_different_axes_is_their_product():
    """The camera on an arm on the base, and a lidar on the base: rotations of a chain do not commute."""
    arm = Rotation.from_euler("z", 40, degrees=True), [0.1, 0.2, 0.3]
    camera = Rotation.from_euler("xyz", [-90, 10, -90], degrees=True), [0.0, 0.5, -0.1]
    lidar = Rotation.from_euler("y", 25, degrees=True), [-0.3, 0.0, 0.4]
    steps = [transform("base", "arm", *arm), transform("arm", "camera", *camera), transform("/base", "lidar", *lidar)]
    tree = TfTree("bag")
    tree.add(SimpleNamespace(transforms=steps))
    base_arm, arm_camera, base_lidar = (matrix(*step) for step in (arm, camera, lidar))
    base_camera = base_arm @ arm_camera
    for parent, expected in (("base", base_camera), ("lidar", np.linalg.inv(base_lidar) @ base_camera)):
        pose = tree.pose(parent, "camera")
        assert pose is not None
        rotation, position_m = pose
        np.testing.assert_allclose(rotation, expected[:3, :3], atol=1e-12)
        np.testing.assert_allclose(position_m, expected[:3, 3], atol=1e-12)
    assert tree.pose("base", "gripper") is None
