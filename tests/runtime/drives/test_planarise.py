"""3-D poses to planar base poses, against numbers worked out by hand and real recordings."""

# pyright: reportOptionalMemberAccess=false

import math

import numpy as np
import pytest

from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.spatial_poses import planarise_base, planarise_camera, up_vector, upright_camera
from edgemap.runtime.inputs.drives import open_drive


def camera_pose(right, down, forward, position):
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, down, forward])
    pose[:3, 3] = position
    return pose


def test_kitti_world_moves_along_its_z_and_turns_left_towards_minus_x():
    start = camera_pose([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0])
    # 2 m ahead, 0.5 m to the left (world -x), facing left
    turned = camera_pose([0, 0, 1], [0, 1, 0], [-1, 0, 0], [-0.5, 0.1, 2.0])
    first, second = planarise_camera(np.array([start, turned]), "-y", None)
    assert first == SE2()
    assert second.vector() == pytest.approx([2.0, 0.5, math.pi / 2])


def test_z_up_world_seen_from_a_start_that_faces_its_y():
    start = camera_pose([1, 0, 0], [0, 0, -1], [0, 1, 0], [5, 5, 1])
    turned = camera_pose([0, -1, 0], [0, 0, -1], [1, 0, 0], [6, 8, 1])  # now facing world x: a right turn
    second = planarise_camera(np.array([start, turned]), "z", None)[1]
    assert second.vector() == pytest.approx([3.0, -1.0, -math.pi / 2])


def test_the_lever_arm_stays_still_when_the_robot_turns_on_the_spot():
    # The lens 0.2 m ahead and 0.1 m left of the turn axis, which stands at the world's origin; z up.
    start = camera_pose([0, -1, 0], [0, 0, -1], [1, 0, 0], [0.2, 0.1, 0.6])
    turned = camera_pose([1, 0, 0], [0, 0, -1], [0, 1, 0], [-0.1, 0.2, 0.6])
    mount = Mount(0.6, forward_m=0.2, left_m=0.1)
    second = planarise_camera(np.array([start, turned]), "z", mount)[1]
    assert second.vector() == pytest.approx([0.0, 0.0, math.pi / 2], abs=1e-12)


@pytest.mark.parametrize("pitch_deg", [0.0, 20.0, -35.0])
@pytest.mark.parametrize("roll_deg", [0.0, 8.0])
@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_any_world_axis_pitch_and_roll_give_back_the_way(pitch_deg, roll_deg, up):
    mount = Mount.from_degrees(0.8, pitch_deg, roll_deg, forward_m=0.15, left_m=-0.05)
    way = [SE2(), SE2(0.5, 0.1, 0.4), SE2(0.7, 0.5, 2.0), SE2(0.1, -0.4, -2.8)]
    axis = up_vector(up)
    other = np.roll(axis, 1)
    world_base = np.column_stack([other, np.cross(axis, other), axis])  # where base x, y, z lie in the world
    poses = []
    for pose in way:
        base = np.eye(4)
        base[:2, :2], base[:2, 3] = pose.rotation(), (pose.x_m, pose.y_m)
        lens = np.eye(4)
        lens[:3, :3], lens[:3, 3] = mount.rotation_base_optical(), mount.position_base_m()
        world = np.eye(4)
        world[:3, :3], world[:3, 3] = world_base, (3.0, -2.0, 1.0)
        poses.append(world @ base @ lens)
    found = planarise_camera(np.array(poses), up, mount)
    for ours, true in zip(found, way, strict=True):
        assert ours.vector() == pytest.approx(true.vector(), abs=1e-9)
    lever = np.array([mount.forward_m, mount.left_m])
    for full, true in zip(upright_camera(np.array(poses), up, mount), way, strict=True):
        turn = np.eye(3)
        turn[:2, :2] = true.rotation()
        np.testing.assert_allclose(full[:3, :3], turn, atol=1e-9)
        np.testing.assert_allclose(full[:3, 3], [*(true.apply(lever) - lever), 0.0], atol=1e-9)


def test_base_poses_head_along_their_x():
    start, moved = np.eye(4), np.eye(4)
    start[:2, :2] = [[0, -1], [1, 0]]  # facing world y
    moved[:2, :2] = [[-1, 0], [0, -1]]
    moved[:2, 3] = (-1, 4)
    assert planarise_base(np.array([start, moved]), "z")[1].vector() == pytest.approx([4.0, 1.0, math.pi / 2])


def test_a_camera_that_looks_along_up_has_no_heading():
    with pytest.raises(CameraError, match="pose 0 looks straight along world_up 'z'"):
        planarise_camera(np.eye(4)[None], "z", None)


def test_real_kitti_drives_ahead_and_its_left_turn_is_positive(shared_data):
    folder = shared_data / "kitti00"
    drive = open_drive(f"kitti:{folder}")
    matrices = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    found = np.array([pose.vector() for pose in drive.truth.poses])
    np.testing.assert_allclose(found[:, 0], matrices[:, 2, 3], atol=1e-6)  # ahead is the world's z
    np.testing.assert_allclose(found[:, 1], -matrices[:, 0, 3], atol=1e-6)  # left is against its x
    # scipy's yaw about the downward y axis, turned round
    from scipy.spatial.transform import Rotation

    about_down = Rotation.from_matrix(matrices[:, :, :3]).as_euler("YXZ")[:, 0]
    np.testing.assert_allclose(np.sin(found[:, 2] + about_down), 0.0, atol=1e-6)
    assert drive.full_poses is not None  # they say the same seen from above, and the height besides
    np.testing.assert_allclose(drive.full_poses[:, :2, 3], found[:, :2], atol=1e-6)
    np.testing.assert_allclose(drive.full_poses[:, 2, 3], -matrices[:, 1, 3], atol=1e-6)
    assert drive.rate_hz == 10.0
    assert len(drive.images) == 700
    assert drive.mount.height_m == 1.65


def test_real_hololens_way_keeps_its_horizontal_steps(shared_data):
    folder = shared_data / "hololens"
    drive = open_drive(f"c2w:{folder}")
    positions = np.loadtxt(folder / "poses.txt").reshape(-1, 4, 4)[:, :3, 3]
    steps = np.hypot(*np.diff(positions[:, [0, 2]], axis=0).T)  # y is up
    found = np.array([pose.vector() for pose in drive.truth.poses])
    np.testing.assert_allclose(np.hypot(*np.diff(found[:, :2], axis=0).T), steps, atol=1e-9)
    assert drive.intrinsics.fx == 495.57
    assert len(drive.images) == len(found) == 200
