"""Two sensors in two clocks: pictures by one, inertial samples or wheels by another; clocks that are set in a drive."""

from datetime import timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from support.fuzzed_room import (
    FLOOR,
    PICTURES,
    SIZE,
    STEPS,
    Checked,
    Room,
    followed,
    pose_at,
    samples,
    saved_map,
    slam_of,
)

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer, ImuCamera
from edgemap.runtime.step.loop import steps

LENGTH = 40
RATE_HZ, IMU_HZ = 10.0, 100.0

offsets = st.sampled_from((0.0, 0.0, 0.02, -0.3, 2.0, -50.0, 3600.0, -1e5, 1.7e9, -1.7e9)) | st.floats(-1e10, 1e10)
changes = st.lists(st.tuples(st.integers(1, LENGTH - 1), offsets), max_size=2)  # frame from which on the clock is off
fuzz = settings(
    max_examples=max(STEPS // LENGTH // 4, 1),
    deadline=timedelta(seconds=60),
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),  # pyright: ignore[reportArgumentType]
    database=None,
)


class Drive(Camera):
    """Pictures at a steady rate. imu, wheel: of the whole drive, in their own clock."""

    def __init__(self, room):
        lens, mount = FLOOR.intrinsics, FLOOR.mount
        super().__init__(CameraInfo("drive", (SIZE, SIZE), lens, mount, rate_hz=RATE_HZ, frame_count=LENGTH))
        self._room = room

    def read(self):
        index = self._delivered
        if index >= LENGTH:
            return None
        self._room.pose = pose_at(0.05 * index)
        return self.frame(PICTURES[index % 16], stamp_of(index), "")


def stamp_of(index):
    return 1000.0 + index / RATE_HZ


def other_clock(stamps_s, offset_s, changed):
    """The stamps by a clock that is off, by as much as the last change says from its frame on."""
    shifted = stamps_s + offset_s
    for frame, off_s in sorted(changed):
        shifted[stamps_s >= stamp_of(frame)] = stamps_s[stamps_s >= stamp_of(frame)] + off_s
    return shifted


def in_order(stamps_s):
    """Rows whose stamps are after all before: what readers of recordings leave of a clock that is set back."""
    return np.concatenate([[True], stamps_s[1:] > np.maximum.accumulate(stamps_s)[:-1]])


def driven(camera, room, imu, corners=False):
    slam, saved = slam_of(camera, room, imu, corners), saved_map()
    slam.mapper.start_in(saved, SE2())
    checked = Checked(slam, saved)
    for result in steps(camera, slam):
        checked(result)
    assert checked.steps == LENGTH
    checked.end()
    return checked


def measured(offset_s, changed):
    """The IMU's samples of the drive, in its own clock."""
    true_s = np.arange(stamp_of(0) - 0.5, stamp_of(LENGTH), 1.0 / IMU_HZ)
    return samples(other_clock(true_s, offset_s, changed).tolist(), 0.2, np.random.default_rng(0))


@pytest.mark.parametrize("live", [False, True])
@fuzz
@given(offsets, changes, followed)
def test_samples_of_another_clock(live, offset_s, changed, corners):
    room = Room(1)
    imu = measured(offset_s, changed)
    camera = Drive(room)
    if live:
        buffer = ImuBuffer(kept=None)
        for row in range(len(imu)):
            buffer.push(float(imu.stamps_s[row]), imu.gyro_rad_s[row].tolist(), imu.accel_m_s2[row].tolist())
        camera = ImuCamera(camera, buffer)
    else:
        rows = in_order(imu.stamps_s)
        samples = ImuSamples(imu.stamps_s[rows], imu.gyro_rad_s[rows], imu.accel_m_s2[rows])
        camera.update_info(imu=samples)
    driven(camera, room, True, corners)


@pytest.mark.parametrize("offset_s", [-1.7e9, -3600.0])
def test_samples_of_another_clock_are_named_once(offset_s):
    camera = Drive(Room(1))
    camera.update_info(imu=measured(offset_s, []))
    checked = driven(camera, Room(1), True)
    assert len([fault for fault in checked.faults if "IMU" in fault]) == 1


@fuzz
@given(offsets, changes, followed)
def test_wheels_of_another_clock(offset_s, changed, corners):
    room = Room(1)
    true_s = np.arange(stamp_of(-5), stamp_of(LENGTH + 5), 0.02)
    stamps_s = other_clock(true_s, offset_s, changed)
    rows = in_order(stamps_s)
    poses = tuple(pose_at(0.05 * (stamp_s - 1000.0) * RATE_HZ) for stamp_s in true_s[rows].tolist())
    camera = Drive(room)
    camera.update_info(wheel=Trajectory(stamps_s[rows], poses))
    driven(camera, room, False, corners)
