"""An IMU made from recorded poses: what it measures is the motion of those poses."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.simulation.carried_imu import carried_imu
from edgemap.simulation.robot.imu import GRAVITY_M_S2, ImuErrors

PERFECT = ImuErrors(**{field.name: 200.0 if field.name == "rate_hz" else 0.0 for field in fields(ImuErrors)})
MOUNT = Mount.from_degrees(1.7, 20.0)


def carried() -> Drive:
    """A head that turns by 0.5 rad/s, nods and walks on at 1 m/s, 10 pictures a second."""
    stamps = np.arange(0.0, 5.0, 0.1)
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    angles = np.column_stack([0.5 * stamps, 0.2 * np.sin(2.0 * stamps), np.zeros(len(stamps))])
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    poses[:, 0, 3] = stamps
    return Drive("c2w", Path(), (), stamps, mount=MOUNT, full_poses=poses)


def test_the_gyro_adds_up_to_the_recorded_rotation():
    drive = carried()
    assert drive.full_poses is not None
    samples = carried_imu(drive, np.random.default_rng(0), errors=PERFECT)
    part = samples.between(1.0, 3.0)
    turned = Rotation.identity()
    for rate in part.gyro_rad_s:
        turned = turned * Rotation.from_rotvec(rate / 200.0)
    optical = drive.full_poses[:, :3, :3] @ MOUNT.rotation_base_optical()
    true = Rotation.from_matrix(optical[10].T @ optical[30])
    assert (true.inv() * turned).magnitude() < 0.01


def test_a_camera_at_rest_before_it_sets_off_feels_gravity_alone():
    samples = carried_imu(carried(), np.random.default_rng(0), rest_s=3.0, errors=PERFECT)
    at_rest = samples.between(-3.8, -2.0)
    assert len(at_rest) > 300
    up = MOUNT.rotation_base_optical().T @ [0.0, 0.0, GRAVITY_M_S2]
    assert at_rest.accel_m_s2.mean(axis=0) == pytest.approx(up, abs=0.02)
    assert np.abs(at_rest.gyro_rad_s).max() < 0.01


def test_a_camera_in_steady_motion_feels_gravity_alone_from_its_first_sample_to_its_last():
    stamps = np.arange(0.0, 5.0, 0.1)
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    poses[:, 0, 3] = stamps
    drive = Drive("c2w", Path(), (), stamps, mount=MOUNT, full_poses=poses)
    samples = carried_imu(drive, np.random.default_rng(0), errors=PERFECT)
    up = MOUNT.rotation_base_optical().T @ [0.0, 0.0, GRAVITY_M_S2]
    assert np.abs(samples.accel_m_s2 - up).max() < 0.01


def test_planar_poses_make_no_imu():
    with pytest.raises(CameraError, match="poses of six dimensions"):
        carried_imu(replace(carried(), full_poses=None), np.random.default_rng(0))
