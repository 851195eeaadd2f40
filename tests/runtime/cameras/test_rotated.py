"""`--rotate`: pictures, depth, lens and inertial samples turn together."""

from itertools import islice

import numpy as np
import pytest

from edgemap.cli.camera_options import open_described
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.camera import CameraOptions, check_size
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.program_camera import FramesCamera
from edgemap.runtime.inputs.cameras.wrappers import RotatedCamera


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_two_turns_that_add_up_to_a_whole_one_change_nothing(degrees):
    with open_described("demo", None) as camera:
        whole = RotatedCamera(RotatedCamera(camera, degrees), 360 - degrees)
        assert whole.info.size == camera.info.size
        assert whole.info.intrinsics == camera.info.intrinsics
        turned, plain = RotatedCamera(camera, degrees).read(), whole.read()
    assert turned is not None
    assert plain is not None
    assert turned.image.shape[:2] == ((480, 640) if degrees == 180 else (640, 480))
    with open_described("demo", None) as again:
        first, second = islice(iter(again.read, None), 2)
    np.testing.assert_array_equal(turned.image, np.rot90(first.image, -degrees // 90))
    np.testing.assert_array_equal(plain.image, second.image)


def test_what_is_stated_is_of_the_upright_pictures():
    with open_described("demo", None) as camera:
        lens = camera.info.intrinsics
    assert lens is not None
    upright = lens.rotated(90)
    with open_described("demo", None, CameraOptions(intrinsics=upright, rotate=90)) as camera:
        assert camera.info.intrinsics == upright
        assert camera.info.size == (480, 640)
        assert camera.info.mount is not None


def test_gravity_of_a_camera_on_its_side_points_up_in_upright_pictures():
    """Its picture's right side is up, so turning it counterclockwise (270 clockwise) makes it upright: up is -y."""
    camera = FramesCamera([np.zeros((48, 64, 3), np.uint8)], (60.0, 60.0, 31.5, 23.5), (0.6, 0.0))
    samples = ImuSamples(np.zeros(1), np.zeros((1, 3)), np.array([[9.81, 0.0, 0.0]]))
    camera.update_info(imu=samples)
    frame = RotatedCamera(camera, 270).read()
    assert frame is not None
    np.testing.assert_allclose(frame.imu.accel_m_s2, [[0.0, -9.81, 0.0]], atol=1e-12)


def test_pictures_without_room_for_anything_are_one_line():
    camera = FramesCamera([np.zeros((12, 64, 3), np.uint8)], (60.0, 60.0, 31.5, 5.5), (0.6, 0.0))
    with pytest.raises(CameraError, match="pictures of 64x12 px, both sides must have 32 px or more"):
        check_size(camera)
