import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise, floor_covariances
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError

PLAIN = Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
EXACT = np.zeros((2, 2))


@given(st.floats(-80, 80), st.floats(-80, 80))
def test_the_direction_up_gives_the_mounts_angles_back(pitch_deg, roll_deg):
    mount = Mount.from_degrees(1.0, pitch_deg, roll_deg)
    up = mount.rotation_base_optical().T @ [0.0, 0.0, 2.5]
    attitude = Attitude.of_up(up, EXACT, "test")
    given = Attitude.of_mount(mount)
    assert (attitude.pitch_rad, attitude.roll_rad) == pytest.approx((given.pitch_rad, given.roll_rad), abs=1e-9)
    assert (given.pitch_rad, given.roll_rad) == (mount.pitch_rad, mount.roll_rad)
    np.testing.assert_array_equal(given.covariance_rad2, EXACT)  # as exact as it is said to be


def test_a_frame_that_nods_sees_the_floor_where_it_is():
    level = FloorCamera(PLAIN, Mount.from_degrees(1.0, 0.0, forward_m=0.2))
    nodding = level.at(Attitude(0.0, math.radians(45.0), EXACT, height_m=0.9))
    # The middle of the picture looks 45 degrees down from 0.9 m: 0.9 m ahead of the lens.
    np.testing.assert_allclose(nodding.floor_points([[319.5, 239.5]]), [[1.1, 0.0]], atol=1e-12)
    assert not level.below_horizon([[319.5, 239.0]])[0]
    assert nodding.below_horizon([[319.5, 239.0]])[0]


def test_a_frame_that_looks_at_the_sky_sees_no_floor_and_is_no_error():
    camera = FloorCamera(PLAIN, Mount.from_degrees(0.5, 10.0)).at(Attitude(0.0, math.radians(-60.0), EXACT))
    assert np.isnan(camera.floor_points([[319.5, 479.0]])).all()
    assert camera.at(Attitude(math.pi, math.pi / 2, EXACT)).mount.roll_rad < math.pi / 2


def test_the_attitudes_covariance_reaches_the_floor_beside_the_axis_as_sampling_has_it():
    """Roll and pitch that err together, for a pixel below and to the right of the middle."""
    mount, pixel, rng = Mount.from_degrees(0.5, 10.0), [[500.0, 400.0]], np.random.default_rng(0)
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]]) * math.radians(0.5) ** 2
    camera = FloorCamera(PLAIN, mount).at(Attitude(0.0, mount.pitch_rad, covariance))
    own, _ = floor_covariances(camera, pixel, [[0.0, 0.0]], FloorNoise(0.0, 0.0))
    tilts = rng.multivariate_normal([0.0, mount.pitch_rad], covariance, 4000)
    places = [camera.at(Attitude(roll, pitch, EXACT)).floor_points(pixel)[0] for roll, pitch in tilts]
    np.testing.assert_allclose(own[0], np.cov(np.transpose(places)), rtol=0.1, atol=2e-5)


def test_imu_samples_between_two_stamps():
    samples = ImuSamples(np.arange(5) / 10.0, np.arange(15.0).reshape(5, 3), np.zeros((5, 3)))
    assert samples.between(0.1, 0.3).stamps_s.tolist() == pytest.approx([0.2, 0.3])
    assert len(ImuSamples.joined([samples, ImuSamples.none(), samples])) == 10
    turn = Mount(1.0).rotation_base_optical()
    np.testing.assert_allclose(samples.rotated(turn).gyro_rad_s[1], [5.0, -3.0, -4.0])
    with pytest.raises(GeometryError, match=r"gyro_rad_s has shape \(4, 3\)"):
        ImuSamples(np.arange(5.0), np.zeros((4, 3)), np.zeros((5, 3)))


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_a_rotation_vectors_matrix_is_scipys(vector):
    np.testing.assert_allclose(small_rotation(*vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
