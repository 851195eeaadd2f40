"""Inertial samples beside the pictures: pushed by a program, and out of a RealSense recording."""

import math
from typing import Any

import numpy as np
import pytest
from support.live_camera import Clock, ScriptedDriver, drain, picture
from support.made_camera import MadeCamera

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer, ImuCamera
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.open import open_camera


def still():
    lens = Intrinsics(8, 6, 8.0, 8.0, 3.5, 2.5)
    return MadeCamera(math.inf, lambda _: np.zeros((6, 8, 3), np.uint8), start_s=0.1, intrinsics=lens)


def test_samples_pushed_by_a_program_come_with_the_frames_once_each():
    buffer = ImuBuffer(rotation=np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]))  # base axes
    camera = ImuCamera(still(), buffer)
    for stamp_s in (0.05, 0.10, 0.15):
        buffer.push(stamp_s, (0.0, 0.0, 1.0), (0.0, 0.0, 9.8))
    buffer.push(0.12, (0.0, 0.0, float("nan")), (0.0, 0.0, 9.8))
    first, second = camera.read(), camera.read()
    assert first is not None
    assert second is not None
    assert first.imu.stamps_s.tolist() == [0.05, 0.10]
    assert second.imu.stamps_s.tolist() == [0.15]
    np.testing.assert_allclose(second.imu.gyro_rad_s, [[0.0, -1.0, 0.0]])  # up is minus y in a camera
    np.testing.assert_allclose(second.imu.accel_m_s2, [[0.0, -9.8, 0.0]])


def test_an_accelerometer_at_its_own_rate_is_interpolated():
    buffer = ImuBuffer()
    for stamp_s, value in ((0.0, 0.0), (0.1, 1.0)):
        buffer.push_force(stamp_s, (value, 0.0, 0.0))
    for stamp_s in (0.02, 0.05):
        buffer.push_rate(stamp_s, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(buffer.take(0.06).accel_m_s2[:, 0], [0.2, 0.5])


@pytest.mark.parametrize("by_s", [-3600.0, -0.3, 5.0])
def test_a_device_clock_that_jumps_shifts_samples_and_pictures_alike(by_s):
    clock = Clock()
    buffer = ImuBuffer(clock_s=clock)

    class Jumping(ScriptedDriver):
        def grab(self):
            self.clock.now_s += 0.001  # as late as the samples are
            for _ in range(20):
                clock.now_s += 0.005
                device_s = clock() - 900.0 + (by_s if clock() > 1002.03 else 0.0)
                buffer.push(device_s, (0.0, 0.0, 0.1), (0.0, 9.8, 0.0))
            number, self.grabs = self.grabs, self.grabs + 1
            return device_s, picture(number)

    driver: Any = Jumping(clock)
    frames = drain(ImuCamera(LiveCamera(driver, clock_s=clock, wait=clock.wait), buffer), 60)
    stamps = np.array([frame.stamp_s for frame in frames])
    np.testing.assert_allclose(np.diff(stamps), 0.101, atol=2e-3)
    assert {len(frame.imu) for frame in frames[1:]} <= {19, 20, 21}
    samples = np.concatenate([frame.imu.stamps_s for frame in frames])
    assert len(samples) == 60 * 20
    assert (np.diff(samples) > 0).all()
    assert max(abs(frame.imu.stamps_s[-1] - frame.stamp_s) for frame in frames) < 0.01


def test_a_realsense_recording_brings_all_of_its_samples(tmp_path):
    pytest.importorskip("pyrealsense2")
    from support.record_motion import record_motion

    with open_camera(f"realsense:{record_motion(tmp_path / 'motion.db3')}") as camera:
        frames = []
        while (frame := camera.read()) is not None:
            frames.append(frame)
    assert len(frames) == 29
    assert camera.info.imu is not None
    assert len(camera.info.imu) == 200
    # The last picture is taken with sample 196; each of the others brings the seven since the one before.
    assert [len(frame.imu) for frame in frames] == [1] + [7] * 28
    np.testing.assert_allclose(frames[1].imu.gyro_rad_s[0], [0.1, 0.2, 0.001], atol=1e-7)
    np.testing.assert_allclose(frames[1].imu.accel_m_s2[0], [0.0, -9.8, 1.0], atol=1e-6)
