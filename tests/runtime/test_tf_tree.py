"""Poses of frames in one another, against products of scipy's rotations."""

from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.bridges.ros2.messages.tf_tree import TfTree


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
