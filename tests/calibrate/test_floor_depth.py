"""The mount from depth pictures: known rooms, a RealSense recording, and refusals with their numbers."""

import math

import numpy as np
import pytest
from support.depth_room import LENS, depth_room

from edgemap.calibrate.floor_depth import fit_floor_depth, gravity
from edgemap.geometry.camera.floor_plane import find_floor
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import Mount, up_optical
from edgemap.runtime.frames.errors import CalibrationError

MOUNT = Mount.from_degrees(0.62, 17.0, 2.0)


@pytest.mark.parametrize("mount", [MOUNT, Mount.from_degrees(0.22, -2.0, 0.5), Mount.from_degrees(1.2, 38.0, -3.0)])
def test_floor_and_not_table_or_wall(mount):
    pictures = [depth_room(mount, noise=0.002, seed=seed) for seed in range(4)]
    fit = fit_floor_depth(pictures, LENS)
    assert fit.mount.height_m == pytest.approx(mount.height_m, abs=0.005)
    assert math.degrees(fit.mount.pitch_rad - mount.pitch_rad) == pytest.approx(0.0, abs=0.2)
    assert math.degrees(fit.mount.roll_rad - mount.roll_rad) == pytest.approx(0.0, abs=0.2)
    assert 0.0 < fit.rms_m < 0.02


def test_a_slope_larger_than_the_floor_is_neither_floor_nor_in_its_way():
    """1 m2 of level floor 0.6 m below the lens, and behind it 6 m2 of a slope of 60 degrees."""
    random = np.random.default_rng(1)
    x, along = random.uniform(-0.5, 0.5, 4000), random.uniform(0.0, 1.0, 4000)
    floor = np.column_stack([x, np.full(4000, 0.6), 1.0 + along])
    x, along = random.uniform(-1.0, 1.0, 6000), random.uniform(0.0, 3.0, 6000)
    rise = math.radians(60.0)
    slope = np.column_stack([x, 0.6 - along * math.sin(rise), 2.0 + along * math.cos(rise)])
    plane = find_floor(np.vstack([floor, slope]), random)
    assert plane.height_m == pytest.approx(0.6, abs=0.005)


def test_a_carried_camera_has_the_mount_of_its_middle_picture():
    pictures = [depth_room(Mount.from_degrees(1.6, pitch)) for pitch in (20.0, 27.0, 27.0, 36.0)]
    with pytest.raises(CalibrationError, match="must be mounted"):
        fit_floor_depth(pictures, LENS)
    mount = fit_floor_depth(pictures, LENS, mounted=False).mount
    assert mount.height_m == pytest.approx(1.6, abs=0.02)
    assert math.degrees(mount.pitch_rad) == pytest.approx(27.0, abs=0.3)


def test_gravity_says_which_plane_is_the_floor():
    steep = Mount.from_degrees(0.8, 52.0)  # the wall is nearer to the picture's own up than the floor
    pictures = [depth_room(steep)] * 4
    fit = fit_floor_depth(pictures, LENS, up_optical(math.radians(50.0), 0.0))
    assert math.degrees(fit.mount.pitch_rad) == pytest.approx(52.0, abs=0.2)


def test_refusals_say_the_numbers():
    wall = np.full((480, 640), 1.5, np.float32)
    with pytest.raises(CalibrationError, match="0 of 4 depth pictures show a floor, need 4"):
        fit_floor_depth([wall] * 4, LENS)
    nodding = [depth_room(Mount.from_degrees(0.62, pitch)) for pitch in (9.0, 13.0, 17.0, 21.0)]
    with pytest.raises(CalibrationError, match=r"5\.9 deg apart from picture to picture"):
        fit_floor_depth(nodding, LENS)
    with pytest.raises(CalibrationError, match="depth picture of 320x240 px, the lens is for 640x480"):
        fit_floor_depth([np.ones((240, 320), np.float32)], LENS)


def test_gravity_is_the_median_of_what_could_be_gravity():
    stamps = np.arange(0.0, 4.0, 0.005)
    force = np.tile(9.81 * up_optical(math.radians(12.0), 0.05), (len(stamps), 1))
    force[:200] *= 1.4  # pushed
    found = gravity(ImuSamples(stamps, np.zeros_like(force), force))
    assert found == pytest.approx(up_optical(math.radians(12.0), 0.05))
    assert gravity(ImuSamples.none()) is None
