"""Random clocks, devices that fail and headings, from the device to the saved map: stamps that jump, stand or go back;
faults of every kind of camera; two sensors in two clocks; a drive is the same drive whichever way its map points."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.fuzzed_room import (
    FLOOR,
    PICTURES,
    SIZE,
    Checked,
    Room,
    followed,
    fuzz,
    pose_at,
    room_camera,
    samples,
    saved_map,
    slam_of,
)
from support.live_camera import Clock

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraInfo, CameraOptions, CameraState, Driver, Picture
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import GrowingTrack, Trajectory
from edgemap.runtime.inputs.cameras.checked import CheckedCamera
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer, ImuCamera
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.relocalisation import SavedMap

LENGTH = 40  # steps of one drive
ODD = (None, math.nan, math.inf, -math.inf, "now", [], 10**400, True, 0.0, -1.0, 1e18, 2**63)
STEP_S = (0.1, 0.1, 0.1, 0.1, 0.033, 1e-4, 0.0, -0.02, 3.0)
JUMPS_S = (-3600.0, 3600.0, 0.5, -1e9, 1e9)

step = st.tuples(
    st.sampled_from(STEP_S) | st.sampled_from(JUMPS_S),
    st.sampled_from((0.1, 0.1, 0.1, 0.033, 1e-4, 3.0)),  # by the host's clock
    st.none() | st.none() | st.sampled_from(ODD) | st.floats(),
)
drives = st.lists(step, min_size=LENGTH, max_size=LENGTH)


class Clocks(Driver):
    """A device whose clock goes as drawn, 1.7e9 s or 5 s at first, and its IMU on that clock; the robot drives on with
    each picture. wheels: where it was, on the clock of the delivered frames."""

    name = "clocks"

    def __init__(self, room, drawn, clock, begin_s, imu):
        self.size, self.intrinsics, self.rate_hz = (SIZE, SIZE), FLOOR.intrinsics, 10.0
        self.room, self.clock, self.imu, self._device_s = room, clock, imu, begin_s
        self._drawn, self.number, self._random = list(drawn), 0, np.random.default_rng(0)

    def open(self):
        return self

    def next(self):
        """Stamp and picture of the next frame; None at the end."""
        if not self._drawn:
            return None
        step_s, host_s, odd = self._drawn.pop(0)
        before_s, self._device_s = self._device_s, self._device_s + step_s
        self.clock.wait(host_s)
        self.number += 1
        turn_rad = (self.room.pose.inverse() @ pose_at(0.05 * self.number)).yaw_rad
        self.room.pose = pose_at(0.05 * self.number)
        stamps = np.linspace(before_s, self._device_s, 8)[1:] if 0.0 < step_s < 10.0 else [self._device_s]
        turned = samples(list(stamps), turn_rad / max(host_s, 0.03), self._random)
        return (self._device_s if odd is None else odd), PICTURES[self.number % 16], turned

    def grab(self):
        given = self.next()
        if given is None:
            self.clock.wait(0.2)
            return None
        stamp_s, image, imu = given
        if self.imu is not None:
            for row in range(len(imu)):
                self.imu.push(float(imu.stamps_s[row]), imu.gyro_rad_s[row], imu.accel_m_s2[row])
        return Picture(stamp_s, image)

    def close(self):
        pass


REASONS = (RuntimeError("USB\nreset"), OSError(19, "No such device"), MemoryError(), ValueError("?"))
DEAD, WEDGED = "dead", "wedged"  # raises, or is silent, until it is opened again
ODD_PICTURES = (None, PICTURES[0][::2, ::2], PICTURES[0].astype(np.float32))
SPOILT = (*REASONS, DEAD, WEDGED, None, "text", *((1.0, picture) for picture in ODD_PICTURES))
# Before which frames the device fails, with what grabs give or raise, and how often it then does not open.
fails = st.tuples(st.lists(st.sampled_from(SPOILT), min_size=1, max_size=25), st.integers(0, 3))
failures = st.dictionaries(st.integers(1, LENGTH - 1), fails, max_size=4)


class Failing(Clocks):
    """The same, steady, which fails before some frames."""

    def __init__(self, failing, *more):
        super().__init__(*more)
        self._failing, self._shut = {at: list(grabs) for at, (grabs, _) in failing.items()}, 0
        self._shuts = {at: times for at, (_, times) in failing.items()}

    def open(self):
        self._shut = self._shut or self._shuts.pop(self.number, 0)
        if self._shut > 0:
            self._shut -= 1
            raise RuntimeError("failed to set power state")
        spoilt = self._failing.get(self.number, [])
        if spoilt and (spoilt[0] is DEAD or spoilt[0] is WEDGED):
            del spoilt[0]
        return self

    def grab(self):
        if spoilt := self._failing.get(self.number):
            self.clock.wait(0.1)
            what = spoilt[0] if spoilt[0] is DEAD or spoilt[0] is WEDGED else spoilt.pop(0)
            if what is DEAD or isinstance(what, Exception):
                raise REASONS[0] if what is DEAD else what
            return None if what is WEDGED else what
        return super().grab()


class Theirs(Camera):
    """Another package's camera, which delivers the device's stamps as they are."""

    def __init__(self, device, imu):
        super().__init__(CameraInfo("theirs", device.size, FLOOR.intrinsics, FLOOR.mount, rate_hz=device.rate_hz))
        self._device, self._imu = device, imu

    def read(self):
        given = self._device.next()
        if given is None:
            return None
        stamp_s, image, imu = given
        frame = Frame(0, stamp_s, image)
        return Frame(0, stamp_s, image, imu=imu) if self._imu else frame


def drive(drawn, begin_s, imu, live, placed, corners, device_of=Clocks):
    """One drive with these clocks through the real camera classes, front end and back end; the camera, and what is on
    the map."""
    room, clock = Room(1), Clock()
    buffer = ImuBuffer(clock_s=clock) if imu and live else None
    device: Any = device_of(room, drawn, clock, begin_s, buffer)
    if live:
        camera = LiveCamera(device, CameraOptions(FLOOR.intrinsics, FLOOR.mount), clock, clock.wait)
        camera = camera if buffer is None else ImuCamera(camera, buffer)
    else:
        camera = CheckedCamera(Theirs(device, imu), "theirs")
    wheels = GrowingTrack()
    camera.update_info(wheel=wheels)
    slam = slam_of(camera, room, imu, corners)
    saved = saved_map()
    mapper, home = slam.mapper, SavedMap(saved)
    mapper.start_in(home, SE2()) if placed else mapper.relocalise_in(home, guesses=[SE2()])
    checked = Checked(slam, saved)
    read = camera.read

    def reading():
        frame = read()
        if frame is not None:
            wheels.push(frame.stamp_s, pose_at(0.05 * device.number))
        return frame

    camera.read = reading
    for result in steps(camera, slam, frames=len(drawn)):
        checked(result)
    assert checked.steps == len(drawn)
    checked.end()
    return camera, checked


@pytest.mark.parametrize("imu", [False, True])
@pytest.mark.parametrize("live", [False, True])
@fuzz(LENGTH, 0.25)
@given(drives, st.sampled_from((5.0, 1.7e9, -5.0)), st.booleans(), followed)
def test_any_clock_gives_a_map(live, imu, drawn, begin_s, placed, corners):
    drive(drawn, begin_s, imu, live, placed, corners)


@fuzz(LENGTH)
@example({5: (list(SPOILT), 0), 20: ([OSError()] * 25, 3)}, True, False)
@given(failures, st.booleans(), followed)
def test_a_camera_that_fails_comes_back_and_its_map_stays(failing, imu, corners):
    """Whatever grabs raise and give, however often it does not open: every frame comes, and no object is lost."""
    steady = [(0.1, 0.1, None)] * LENGTH
    camera, checked = drive(steady, 5.0, imu, True, True, corners, partial(Failing, failing))
    assert camera.state is CameraState.RUNNING
    raised = any(isinstance(what, Exception) for grabs, _ in failing.values() for what in grabs)
    assert {"failed", "recovered"} <= checked.kinds or not raised


RATE_HZ, IMU_HZ = 10.0, 100.0

offsets = st.sampled_from((0.0, 0.0, 0.02, -0.3, 2.0, -50.0, 3600.0, -1e5, 1.7e9, -1.7e9)) | st.floats(-1e10, 1e10)
changes = st.lists(st.tuples(st.integers(1, LENGTH - 1), offsets), max_size=2)  # frame from which on the clock is off


def steady_drive(room):
    """A camera at a steady rate on a robot that drives on."""

    def drive_on(index):
        room.pose = pose_at(0.05 * index)

    return room_camera(LENGTH, drive_on, rate_hz=RATE_HZ, start_s=1000.0, frame_count=LENGTH)


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


def driven_with(camera, room, imu, corners=False):
    slam, saved = slam_of(camera, room, imu, corners), saved_map()
    slam.mapper.start_in(SavedMap(saved), SE2())
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
@fuzz(LENGTH, 0.25)
@given(offsets, changes, followed)
def test_samples_of_another_clock(live, offset_s, changed, corners):
    room = Room(1)
    imu = measured(offset_s, changed)
    camera = steady_drive(room)
    if live:
        buffer = ImuBuffer(kept=None)
        for row in range(len(imu)):
            buffer.push(float(imu.stamps_s[row]), imu.gyro_rad_s[row].tolist(), imu.accel_m_s2[row].tolist())
        camera = ImuCamera(camera, buffer)
    else:
        rows = in_order(imu.stamps_s)
        samples = ImuSamples(imu.stamps_s[rows], imu.gyro_rad_s[rows], imu.accel_m_s2[rows])
        camera.update_info(imu=samples)
    driven_with(camera, room, True, corners)


@pytest.mark.parametrize("offset_s", [-1.7e9, -3600.0])
def test_samples_of_another_clock_are_named_once(offset_s):
    camera = steady_drive(Room(1))
    camera.update_info(imu=measured(offset_s, []))
    checked = driven_with(camera, Room(1), True)
    assert len([fault for fault in checked.faults if "IMU" in fault]) == 1


@fuzz(LENGTH, 0.25)
@given(offsets, changes, followed)
def test_wheels_of_another_clock(offset_s, changed, corners):
    room = Room(1)
    true_s = np.arange(stamp_of(-5), stamp_of(LENGTH + 5), 0.02)
    stamps_s = other_clock(true_s, offset_s, changed)
    rows = in_order(stamps_s)
    poses = tuple(pose_at(0.05 * (stamp_s - 1000.0) * RATE_HZ) for stamp_s in true_s[rows].tolist())
    camera = steady_drive(room)
    camera.update_info(wheel=Trajectory(stamps_s[rows], poses))
    driven_with(camera, room, False, corners)


ROUND_TRIPS = 100  # steps of one drive forth and back


def straight(index, swing_rad):
    """Forth and back on a line, with a heading that swings about that of the line."""
    a = index / 12.0
    return SE2(1.2 * (1.0 - math.cos(a)), 0.1 * math.sin(2.0 * a), swing_rad * math.sin(3.0 * a))


def drifting_camera(room, swing_rad, seed):
    """A camera at 10 Hz, and wheels that drift a little. room: what the pictures show."""
    wheels, odometry, random = GrowingTrack(), [SE2()], np.random.default_rng(seed)

    def drive_on(index):
        before, room.pose = room.pose, straight(index, swing_rad)
        motion = (before.inverse() @ room.pose).vector()
        odometry.append(odometry[-1] @ SE2(*(motion * 1.01 + random.normal(0.0, [2e-3, 1e-3, 2e-3]))))
        wheels.push(index / 10.0, odometry[-1])

    return room_camera(ROUND_TRIPS, drive_on, wheel=wheels)


def driven(start, swing_rad, seed):
    """Poses relative to the start, stamps of corrections, and places and covariances of the objects, of one drive that
    starts at this pose of its map."""
    room = Room(seed, straight(0, swing_rad))
    camera = drifting_camera(room, swing_rad, seed)
    slam = slam_of(camera, room, False, False)
    saved = saved_map(straight(0, swing_rad), start)
    slam.mapper.start_in(SavedMap(saved), start)
    checked, poses, corrected = Checked(slam, saved), [], []
    for result in steps(camera, slam):
        checked(result)
        poses.append((start.inverse() @ result.pose_map_base).vector())
        if result.correction is not None:
            corrected.append(result.frame.index)
    back, objects = start.rotation().T, {}
    for item in checked.end():
        own = back @ item.covariance_m2 @ back.T
        objects[item.id] = np.column_stack([start.inverse().apply(item.position_m), own])
    return np.array(poses), corrected, objects


@fuzz(ROUND_TRIPS, 0.5)
@example(math.pi / 2.0, 0.05, 1)  # nothing prefers an axis of the map
@given(st.floats(math.pi - 0.05, math.pi + 0.05), st.floats(0.0, 0.1), st.integers(0, 1 << 30))
def test_a_drive_about_pi_is_as_one_about_zero(turn_rad, swing_rad, seed):
    poses, corrected, objects = driven(SE2(), swing_rad, seed)
    turned, turned_corrected, turned_objects = driven(SE2(0.0, 0.0, turn_rad), swing_rad, seed)
    assert turned_corrected == corrected
    np.testing.assert_allclose(turned, poses, atol=1e-4)
    assert turned_objects.keys() == objects.keys()
    for identity, known in objects.items():
        np.testing.assert_allclose(turned_objects[identity], known, atol=1e-4)
