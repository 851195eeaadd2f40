"""Poses of a running SLAM by its tf and by the path that it publishes, through Cyclone DDS within one process."""

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (extra 'ros2')")
from edgemap.bridges.ros2.dds.discovery import Discovery
from edgemap.bridges.ros2.dds.node import Node, Publisher
from edgemap.bridges.ros2.dds.tf_poses import live_tf_poses
from edgemap.bridges.ros2.messages import build
from edgemap.bridges.ros2.messages.topics import TF
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2

LOOP, COUNT = 100, 130
STAMPS_S = 1.7e9 + 0.1 * np.arange(COUNT)


def test_a_path_that_comes_after_a_correction_replaces_its_spread():
    """Odometry slips by 0.3 m in a second, which a loop shows later: tf does not know where, the path does."""
    true = [SE2(0.05 * i, 0.0, 0.0) for i in range(COUNT)]
    odom = [SE2(0.05 * i, 0.3 * np.clip((i - 40) / 10, 0.0, 1.0), 0.0) for i in range(COUNT)]
    node = Node(Discovery(1 + (os.getpid() + 80) % 100, "OFF"))
    tf, path = Publisher(node, TF, TF.kind), Publisher(node, "/mapPath", "nav_msgs/msg/Path")

    def publish(index):
        stamps_ns = [round(stamp_s * 1e9) for stamp_s in STAMPS_S[: index + 1].tolist()]
        joined = SE2() if index < LOOP else true[index] @ odom[index].inverse()
        steps = ("map", "odom", joined), ("odom", "base_link", odom[index])
        tf.write(build.tf(*(build.planar_transform(stamps_ns[-1], *step) for step in steps)))
        if index > LOOP and index % 10 == 0:
            nodes = [build.goal_pose(true[i], "map", stamps_ns[i]) for i in range(0, index + 1, 10)]
            path.write({"header": build.header(stamps_ns[-1], "map"), "poses": nodes})

    with ThreadPoolExecutor() as pool:
        opening = pool.submit(live_tf_poses(node, "test", float), "", Mount.from_degrees(0.6, 11.5))
        while not opening.done():
            publish(0)
            time.sleep(0.02)
    given, off_m = opening.result(), dict[int, float]()
    for index, stamp_s in enumerate(STAMPS_S.tolist()):
        publish(index)
        if (at := given.correction(stamp_s)) is not None:
            off_m[index] = max(abs(at(before_s).y_m) for before_s in STAMPS_S[: index + 1].tolist())
    assert list(off_m) == [0, 1, LOOP, LOOP + 10]
    assert off_m[LOOP] == pytest.approx(0.15, abs=0.04)
    assert off_m[LOOP + 10] == pytest.approx(0.0, abs=1e-3)
