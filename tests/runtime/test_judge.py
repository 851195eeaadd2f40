"""Poses, wheels and gyro that contradict the camera are named, and honest ones are not."""

import math
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.drives import drive, exact, round_trip

from edgemap.benchmarks.map_variants import replayed
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.motion.attitude.imu_trust import ImuTrust
from edgemap.runtime.motion.depth_scale import DepthScale
from edgemap.runtime.motion.given_poses import read_given
from edgemap.runtime.motion.judge import MotionJudge, path_of
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.motion.trust import TrustRule
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.slam import SlamOptions

MOUNT = Mount.from_degrees(0.6, 11.5, forward_m=0.15)
STAMPS_S = np.arange(0.0, 20.0, 0.1)


def driven(random: np.random.Generator) -> Array:
    """Poses (N, 3) of a robot that speeds up, slows down and turns both ways."""
    yaw_rad = np.cumsum(0.06 * np.sin(STAMPS_S * random.uniform(0.5, 0.9)) + 0.02 * np.sin(3.0 * STAMPS_S))
    step_m = 0.04 + 0.02 * np.sin(STAMPS_S)
    return np.column_stack([np.cumsum(step_m * np.cos(yaw_rad)), np.cumsum(step_m * np.sin(yaw_rad)), yaw_rad])


def judged(random: np.random.Generator, stamps_s: Array, poses: Array) -> str:
    """What a judge says of poses, by a camera that errs by 3 % and a millimetre."""
    seen, judge, path = [SE2(*pose) for pose in driven(random)], MotionJudge(), path_of(stamps_s, poses)
    scale = random.uniform(0.97, 1.03, 3)
    for at in range(1, len(seen)):
        motion = (seen[at - 1].inverse() @ seen[at]).vector() * scale + random.normal(0.0, 0.001, 3)
        step = SE2(*motion), np.diag([1e-5, 1e-5, 1e-6])
        if judge.add(STAMPS_S[at - 1], STAMPS_S[at], step) and (wrong := judge.judge(path)):
            return wrong
    return ""


@pytest.mark.parametrize(
    ("lie", "named"),
    [
        (lambda t, p: (t, p), ""),
        (lambda t, p: (t, p + [5.0, -3.0, 0.0]), ""),
        (lambda t, p: (t, p * [0.5, 0.5, 1.0]), "its length is"),
        (lambda t, p: (t, p * [1000.0, 1000.0, 1.0]), "millimetres"),
        (lambda t, p: (t, p * [1.0, 1.0, math.degrees(1.0)]), "degrees"),
        (lambda t, p: (t, p * [1.0, -1.0, -1.0]), "sign is reversed"),
        (lambda t, p: (t, p + [0.0, 0.0, math.pi / 2]), "turned by -90 deg"),
        (lambda t, p: (t + 0.1, p), "0.10 s late"),
        (lambda t, p: (t + 0.9, p), "0.90 s late"),
        (lambda t, p: (t - 0.3, p), "0.30 s early"),
        (lambda t, p: (t, p * [1.0, 1.0, 0.0]), "yaw does not follow"),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_a_lie_is_named_and_the_truth_is_not(lie, named: str, seed: int) -> None:
    stamps_s, poses = lie(STAMPS_S, driven(np.random.default_rng(seed)))
    said = judged(np.random.default_rng(seed), stamps_s, poses)
    assert named in said if named else not said


def written(path: Path, poses: Array, stamps: Array = STAMPS_S, w_first: bool = False) -> Path:
    """A TUM file of poses (N, 4, 4)."""
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    quaternions = quaternions[:, [3, 0, 1, 2]] if w_first else quaternions
    np.savetxt(path, np.column_stack([stamps, poses[:, :3, 3], quaternions]), "%.9f")
    return path


@pytest.mark.parametrize("w_first", [False, True])
@pytest.mark.parametrize("unit_m", [1.0, 0.001])
@pytest.mark.parametrize("kind", ["base", "camera, z up", "first camera"])
def test_axes_order_and_units_of_a_file_are_found_out(tmp_path: Path, kind: str, unit_m: float, w_first: bool) -> None:
    true = driven(np.random.default_rng(1))
    poses = np.tile(np.eye(4), (len(true), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(true[:, 2], [0.0, 0.0, 1.0])).as_matrix()
    poses[:, :2, 3] = true[:, :2]
    lens = np.eye(4)
    lens[:3, :3], lens[:3, 3] = MOUNT.rotation_base_optical(), MOUNT.position_base_m()
    poses = poses if kind == "base" else poses @ lens
    poses = np.linalg.inv(poses[0]) @ poses if kind == "first camera" else poses
    poses[:, :3, 3] /= unit_m
    given = read_given(written(tmp_path / "a.tum", poses, 1000.0 * STAMPS_S, w_first), MOUNT).by_clock("a", 0.0, 19.9)
    assert len(given.read_as) == 1 + w_first + (kind != "base") + (unit_m < 1.0)
    places = [(pose.x_m, pose.y_m) for pose in given.trajectory.poses]
    np.testing.assert_allclose(places, SE2(*true[0]).inverse().apply(true[:, :2]), atol=1e-4)
    np.testing.assert_allclose(given.trajectory.stamps_s, STAMPS_S)
    if kind == "base":
        assert given.attitudes is None
    else:
        assert given.attitudes is not None
        assert given.attitudes.at(3.0, 0.6).pitch_rad == pytest.approx(MOUNT.pitch_rad, abs=1e-4)


def test_poses_of_another_time_are_refused_with_both_spans(tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (len(STAMPS_S), 1, 1))
    file = read_given(written(tmp_path / "a.tum", poses, STAMPS_S + 500.0), MOUNT)
    with pytest.raises(OdometryError, match=r"500\.000 to 519\.900 s, the pictures from 0\.000 to 9\.000 s"):
        file.by_clock("a.tum", 0.0, 9.0)


UP = MOUNT.rotation_base_optical().T @ [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("turn", "late_s", "gravity", "named"),
    [
        (np.eye(3), 0.0, 9.81, ""),
        (np.eye(3), 0.3, 9.81, "0.30 s late"),
        (-np.eye(3), 0.0, 9.81, "gyro: its yaw is"),
        (Rotation.from_euler("x", 90, degrees=True).as_matrix(), 0.0, 9.81, "turns gravity"),
        (np.eye(3), 0.0, 0.0, "accelerometer: it measures 0.0 m/s2"),
        (np.eye(3), 0.0, 1.0, "(in g?)"),
        (np.eye(3), 0.0, -9.81, "180 deg off the mount's up"),
    ],
)
def test_a_gyro_or_accelerometer_that_lies_is_named(turn: Array, late_s: float, gravity: float, named: str) -> None:
    true, fine_s = [SE2(*pose) for pose in driven(np.random.default_rng(2))], np.arange(0.0, 19.8, 0.01)
    rate = np.gradient(np.interp(fine_s, STAMPS_S, [pose.yaw_rad for pose in true]), fine_s)
    random = np.random.default_rng(3)
    gyro = (np.outer(rate, UP) @ turn.T).real + random.normal(0.0, 0.002, (len(fine_s), 3))
    force = gravity * UP + random.normal(0.0, 0.02 if gravity else 0.0, (len(fine_s), 3))
    samples, trust, texts, moved = ImuSamples(fine_s + late_s, gyro, force), ImuTrust(0.5, TrustRule()), [], None
    for at in range(1, len(true)):
        part = samples.between(STAMPS_S[at - 1], STAMPS_S[at])
        _, fault = trust.judge(part, STAMPS_S[at], moved, UP, np.zeros(3))
        texts += [fault.text] if fault else []
        moved = true[at - 1].inverse() @ true[at], np.diag([1e-5, 1e-5, 1e-6])
    assert named in texts[0] if named else not texts


@pytest.mark.parametrize(("scale", "wrong"), [(0.2, True), (0.5, True), (1.05, False), (2.0, True), (5.0, True)])
@pytest.mark.parametrize("table", [False, True])
def test_a_scale_of_depth_is_named_and_a_table_like_floor_is_none(scale: float, wrong: bool, table: bool) -> None:
    lens = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)
    camera, judge = FloorCamera(lens, MOUNT), DepthScale(MOUNT.height_m, 0.25)
    v, u = np.mgrid[0:480, 0:640]
    down = -camera.rays_base(np.column_stack([u.ravel(), v.ravel()]))[:, 2].reshape(480, 640)
    depth_m = np.where(down > 0.05, MOUNT.height_m / np.maximum(down, 0.05), 0.0)
    mask = FloorMask(np.where(depth_m[::16, ::16] > 0.0, 1.0, 0.0).astype(np.float32), 640, 480)
    low_m = depth_m * np.where(table & (v < 400), 0.55, 1.0)  # looks like floor but for the last rows
    depth, faults, fit = SparseDepth.of((scale * low_m).astype(np.float32)), [], []
    for _ in range(15):
        fit.append(judge.fit)  # what the map takes in before
        faults.append(judge.judge(depth, mask, camera, None))
    assert judge.wrong == (wrong and not (table and scale == 2.0))
    assert any(faults) == judge.wrong
    assert fit == [not judge.wrong and picture >= 10 for picture in range(15)]


def test_depth_of_a_camera_that_sees_no_floor_is_used_after_twice_as_many_pictures() -> None:
    camera, judge = FloorCamera(Intrinsics(64, 48, 58.0, 58.0, 31.5, 23.5), MOUNT), DepthScale(MOUNT.height_m, 0.25)
    wall, fit = SparseDepth.of(np.full((48, 64), 2.0, np.float32)), list[bool]()
    for _ in range(25):
        fit.append(judge.fit)
        assert judge.judge(wall, None, camera, None) is None
    assert fit == [picture >= 20 for picture in range(25)]


def test_the_map_moves_to_the_camera_s_path_where_given_poses_have_proved_wrong() -> None:
    room = [("chair", 1.0, 1.0), ("bed", 7.0, 5.0), ("tv", 4.0, 5.7), ("plant", 7.6, 3.0), ("table", 0.4, 3.0)]
    poses, mapper = round_trip(120), Mapper()
    true = exact(poses)
    motions = [replace(one, motion=SE2(0.5 * one.motion.x_m, one.motion.y_m, 0.7 * one.motion.yaw_rad)) for one in true]
    motions[100:] = true[100:]
    path = Trajectory(np.arange(120) / 10.0, tuple(poses))
    motions[100] = replace(true[100], instead=lambda stamp_s: path.at(stamp_s) if stamp_s >= 0.0 else None)
    (*_, (_, objects)) = drive(mapper, room, poses, motions)
    expected = poses[0].inverse() @ poses[-1]
    np.testing.assert_allclose(mapper.pose_map_base.vector(), expected.vector(), atol=1e-6)
    places = {item.label: item.position_m for item in objects}
    for label, x_m, y_m in room:
        np.testing.assert_allclose(places[label], poses[0].inverse().apply(np.array([x_m, y_m])), atol=0.25)
    assert len(objects) == len(places)


def test_where_a_file_ends_the_camera_goes_on(tmp_path: Path) -> None:
    drive, motions = open_drive(f"drive:{DEMO}"), list[Motion]()
    rows = [row for row in (DEMO / "poses.tum").read_text().splitlines(True) if not row.startswith("#")]
    (tmp_path / "a.tum").write_text("".join(rows[:30]))
    how, bundle = SlamOptions(str(tmp_path / "a.tum"), wheels=False), load_bundle(bundle_folder("edgemap-nano"))
    replayed(drive, bundle, {"own": how}, 60, Config(), lambda _, result: motions.append(result.motion))
    assert all(motion.measured for motion in motions[1:])
    ends = [(at, fault.kind) for at, motion in enumerate(motions) for fault in motion.faults]
    assert ends == [(31, FaultKind.POSES)]  # once; 0.15 s beyond the end still count as it
    assert drive.truth is not None
    true = drive.truth.poses[29].inverse() @ drive.truth.poses[59]
    moved = reduce(SE2.__matmul__, (motion.motion for motion in motions[30:]))
    assert (moved.inverse() @ true).is_within(0.1)


def test_the_imu_is_judged_by_the_camera_not_by_poses_of_a_file(tmp_path: Path) -> None:
    drive, motions = open_drive(f"drive:{DEMO}"), list[Motion]()
    assert drive.truth is not None
    still = [f"{stamp_s} 0 0 0 0 0 0 1\n" for stamp_s in drive.truth.stamps_s]
    (tmp_path / "a.tum").write_text("".join(still))
    how, bundle = SlamOptions(str(tmp_path / "a.tum"), wheels=False), load_bundle(bundle_folder("edgemap-nano"))
    replayed(drive, bundle, {"own": how}, 20, Config(), lambda _, result: motions.append(result.motion))
    true = drive.truth.poses[0].inverse() @ drive.truth.poses[19]
    moved = reduce(SE2.__matmul__, (seen[0] for one in motions[1:] if (seen := one.moved())))
    assert all(one.motion == SE2() for one in motions)
    assert not true.is_within(0.1)
    assert (moved.inverse() @ true).is_within(0.03)
