"""A robot or a head that nods, and its IMU: truth, samples and pictures agree, and nothing else changes."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.inertial import AboutMount

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, open_drive, write_drive
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.simulation.carried_imu import carried_imu
from edgemap.simulation.render.view import View
from edgemap.simulation.robot.imu import GRAVITY_M_S2, ImuErrors, imu_samples
from edgemap.simulation.robot.motion import SAMPLE_S, Limits, Sampled, stand, straight, turn
from edgemap.simulation.robot.nodding import Nodding, lean, nodding_of
from edgemap.simulation.world import Choices, draw_world

MOUNT = Mount.from_degrees(0.5, 12.0, 1.0, 0.15, 0.02)
PERFECT = ImuErrors(**{field.name: 200.0 if field.name == "rate_hz" else 0.0 for field in fields(ImuErrors)})


def driven(rounds=6):
    parts = [stand(np.zeros(3), 3.0)]
    for _ in range(rounds):
        parts += [straight(parts[-1][-1], 2.0, Limits()), turn(parts[-1][-1], 0.0, Limits())]
        parts.append(turn(parts[-2][-1], math.pi / 2.0, Limits()))
    return Sampled(np.concatenate(parts))


def test_a_braking_robot_nods_forward_and_a_level_floor_lets_it_settle():
    motion = driven(1)
    tilts = nodding_of(motion, (1,), Nodding(thresholds_per_m=1e-9, carpets_per_m=1e-9))
    samples, speed = tilts.samples, np.linalg.norm(np.diff(motion.samples[:, :2], axis=0), axis=1) / SAMPLE_S
    fastest = int(speed.argmax())
    assert samples[:fastest, 1].min() < -0.004  # it sits back as it starts
    assert samples[fastest:, 1].max() > 0.004
    assert np.abs(samples[:140]).max() < 1e-3
    assert np.abs(samples[-20:, 1]).max() < 1e-3
    assert not samples[:, 2].any()


def test_a_threshold_lifts_front_and_rear_one_after_the_other():
    rule = Nodding(thresholds_per_m=0.6, carpets_per_m=1e-9, pitch_per_accel=0.0, roll_per_accel=0.0, askew_m=0.0)
    tilts = nodding_of(driven(), (3,), rule).samples
    assert 0.004 < tilts[:, 2].max() < 0.014
    assert np.degrees(tilts[:, 1].max()) == pytest.approx(-np.degrees(tilts[:, 1].min()), rel=0.2)
    assert 1.0 < np.degrees(tilts[:, 1].max()) < math.degrees(0.014 / rule.base_m)
    assert np.abs(tilts[:, 0]).max() < 1e-9


def test_samples_without_errors_are_the_motions_own():
    motion = driven(2)
    tilts = nodding_of(motion, (1,))
    samples = imu_samples(motion, tilts, MOUNT, 10.0, np.random.default_rng(0), PERFECT)
    at_rest = samples.between(0.5, 2.5)
    up = MOUNT.rotation_base_optical().T @ [0.0, 0.0, GRAVITY_M_S2]
    assert at_rest.accel_m_s2.mean(axis=0) == pytest.approx(up, abs=1e-3)
    assert np.abs(at_rest.gyro_rad_s).max() < 1e-4
    turned = samples.gyro_rad_s @ MOUNT.rotation_base_optical().T  # in base axes
    yaw = np.cumsum(turned[:, 2]) / 200.0
    true = np.interp(samples.stamps_s, np.arange(len(motion.samples)) * SAMPLE_S, motion.samples[:, 2])
    assert np.degrees(np.abs(yaw - true).max()) < 0.1  # 0.6 where the yaw is rounded off more than the pictures'


def test_a_datasheets_imu_follows_the_nods():
    """70 mg of offset are up to 4 degrees, which turn with the robot: learnt against the mount and taken out."""
    motion = driven()
    tilts, rng = nodding_of(motion, (2,)), np.random.default_rng(4)
    duration_s = (len(motion.samples) - 1) * SAMPLE_S
    samples = imu_samples(motion, tilts, MOUNT, duration_s, rng)
    source, blank, errors = AboutMount(MOUNT), np.zeros((4, 4, 3), np.uint8), []
    for index in range(1, int(duration_s * 10)):
        stamp_s = index / 10
        frame = Frame(index, stamp_s, blank, imu=samples.between(stamp_s - 0.1, stamp_s))
        turned = lean(tilts.at(np.array([stamp_s]))[0]) @ MOUNT.rotation_base_optical()
        true = Attitude.of_up(turned[2], np.eye(2), "")
        found = source.predict(frame)
        errors.append((found.pitch_rad - true.pitch_rad, found.roll_rad - true.roll_rad))
    off = np.degrees(np.array(errors)[30:])
    assert np.sqrt((off**2).mean(axis=0)).max() < 0.35
    assert np.abs(off).max() < 1.0


def test_the_truth_of_a_drive_holds_the_tilts(tmp_path):
    stamps = np.arange(5) / 10.0
    poses = tuple(SE2(0.1 * index, 0.02 * index, 0.1 * index) for index in range(5))
    tilts = np.array([(0.0, 0.0, 0.0), (0.01, 0.03, 0.005), (-0.02, 0.01, 0.01), (0.0, -0.04, 0.0), (0.03, 0.0, 0.002)])
    lens = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    write_drive(tmp_path, CameraFile(lens, MOUNT, 10.0), Trajectory(stamps, poses), tilts=tilts)
    (tmp_path / "images").mkdir()
    for index in range(5):
        (tmp_path / f"images/{index}.png").write_bytes(b"")
    drive = open_drive(f"drive:{tmp_path}")
    for index, (pose, tilt) in enumerate(zip(poses, tilts, strict=True)):
        assert drive.truth.poses[index].vector() == pytest.approx(pose.vector(), abs=1e-3)
        found = drive.attitudes.at(stamps[index], MOUNT.height_m)
        view = View.of_base(pose, MOUNT, lean(tilt), float(tilt[2]))
        true = Attitude.of_up(view.rotation_home_optical[2], np.eye(2), "")
        assert (found.roll_rad, found.pitch_rad) == pytest.approx((true.roll_rad, true.pitch_rad), abs=1e-6)
        assert found.height_m == pytest.approx(view.position_home_m[2], abs=1e-6)


def test_options_change_nothing_else_that_a_seed_draws(furniture_catalogue):
    level, nodding = (draw_world(9107, 5, Choices(contract=False, nodding=on, imu=on)) for on in (False, True))
    assert (level.motion.samples == nodding.motion.samples).all()
    assert (level.camera, level.effects, level.apartment.furniture) == (
        nodding.camera, nodding.effects, nodding.apartment.furniture,
    )  # fmt: skip
    assert level.tilts is None
    assert nodding.tilts is not None


HEAD = Mount.from_degrees(1.7, 20.0)


def carried(turned: float = 1.0) -> Drive:
    """A head that turns by 0.5 rad/s and nods, times a factor, and walks on at 1 m/s, 10 pictures a second."""
    stamps = np.arange(0.0, 5.0, 0.1)
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    angles = turned * np.column_stack([0.5 * stamps, 0.2 * np.sin(2.0 * stamps), np.zeros(len(stamps))])
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    poses[:, 0, 3] = stamps
    return Drive("c2w", Path(), (), stamps, mount=HEAD, full_poses=poses)


def test_the_gyro_adds_up_to_the_recorded_rotation():
    drive = carried()
    samples = carried_imu(drive, np.random.default_rng(0), errors=PERFECT)
    part = samples.between(1.0, 3.0)
    turned = Rotation.identity()
    for rate in part.gyro_rad_s:
        turned = turned * Rotation.from_rotvec(rate / 200.0)
    optical = drive.full_poses[:, :3, :3] @ HEAD.rotation_base_optical()
    true = Rotation.from_matrix(optical[10].T @ optical[30])
    assert (true.inv() * turned).magnitude() < 0.01


def test_a_camera_at_rest_before_it_sets_off_or_in_steady_motion_feels_gravity_alone():
    samples = carried_imu(carried(), np.random.default_rng(0), rest_s=3.0, errors=PERFECT)
    at_rest = samples.between(-3.8, -2.0)
    assert len(at_rest) > 300
    up = HEAD.rotation_base_optical().T @ [0.0, 0.0, GRAVITY_M_S2]
    assert at_rest.accel_m_s2.mean(axis=0) == pytest.approx(up, abs=0.02)
    assert np.abs(at_rest.gyro_rad_s).max() < 0.01
    steady = carried_imu(carried(turned=0.0), np.random.default_rng(0), errors=PERFECT)
    assert np.abs(steady.accel_m_s2 - up).max() < 0.01  # from its first sample to its last


def test_planar_poses_make_no_imu():
    with pytest.raises(CameraError, match="poses of six dimensions"):
        carried_imu(replace(carried(), full_poses=None), np.random.default_rng(0))
