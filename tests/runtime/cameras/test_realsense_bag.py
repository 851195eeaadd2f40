"""A `.bag` in librealsense's layout, written by an independent ROS library and read by librealsense."""

import numpy as np
import pytest

from edgemap.runtime.inputs.open import open_camera

pytest.importorskip("pyrealsense2")
pytest.importorskip("rosbags", reason="the ROS bag writer `rosbags` is not installed")

LENS = (615.2, 615.4, 321.1, 239.7)


def test_a_bag_with_depth_and_colour_gives_every_colour_frame(tmp_path):
    from support.write_realsense_bag import write_realsense_bag

    random = np.random.default_rng(2)
    pictures = [random.integers(0, 256, (480, 640, 3), dtype=np.uint8) for _ in range(30)]
    stamps = [100.0 + i / 30 for i in range(30)]
    path = write_realsense_bag(tmp_path / "drive.bag", pictures, stamps, LENS)
    with open_camera(f"realsense:{path}") as camera:
        lens = camera.info.intrinsics
        assert (lens.fx, lens.fy, lens.cx, lens.cy) == LENS
        for picture, stamp in zip(pictures, stamps, strict=True):
            frame = camera.read()
            assert frame.stamp_s == pytest.approx(stamp, abs=1e-6)
            np.testing.assert_array_equal(frame.image[..., ::-1], picture)
        assert camera.read() is None
