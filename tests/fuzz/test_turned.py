"""Headings about pi: a drive is the same drive whichever way its map frame points, loop closures included."""

import math

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from support.fuzzed_room import FLOOR, PICTURES, SIZE, STEPS, Checked, Room, saved_map, slam_of

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.frames.trajectory import GrowingTrack
from edgemap.runtime.step.loop import steps

LENGTH = 100
fuzz = settings(
    max_examples=max(STEPS // LENGTH // 2, 1),
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),  # pyright: ignore[reportArgumentType]
    database=None,
)


def straight(index, swing_rad):
    """Forth and back on a line, with a heading that swings about that of the line."""
    a = index / 12.0
    return SE2(1.2 * (1.0 - math.cos(a)), 0.1 * math.sin(2.0 * a), swing_rad * math.sin(3.0 * a))


class Drive(Camera):
    """Pictures at 10 Hz; the wheels drift a little. room: what the pictures show."""

    def __init__(self, room, swing_rad, seed):
        self._wheels = GrowingTrack()
        lens, mount = FLOOR.intrinsics, FLOOR.mount
        super().__init__(CameraInfo("drive", (SIZE, SIZE), lens, mount, rate_hz=10.0, wheel=self._wheels))
        self._room, self._swing_rad = room, swing_rad
        self._odometry, self._random = SE2(), np.random.default_rng(seed)

    def read(self):
        index = self._delivered
        if index >= LENGTH:
            return None
        before, self._room.pose = self._room.pose, straight(index, self._swing_rad)
        motion = (before.inverse() @ self._room.pose).vector()
        self._odometry = self._odometry @ SE2(*(motion * 1.01 + self._random.normal(0.0, [2e-3, 1e-3, 2e-3])))
        self._wheels.push(index / 10.0, self._odometry)
        return self.frame(PICTURES[index % 16], index / 10.0, "")


def driven(start, swing_rad, seed):
    """Poses relative to the start, stamps of corrections, and objects of one drive that starts at this pose of its
    map."""
    room = Room(seed, straight(0, swing_rad))
    camera = Drive(room, swing_rad, seed)
    slam = slam_of(camera, room, False, False)
    saved = saved_map(straight(0, swing_rad), start)
    slam.mapper.start_in(saved, start)
    checked, poses, corrected = Checked(slam, saved), [], []
    for result in steps(camera, slam):
        checked(result)
        poses.append((start.inverse() @ result.pose_map_base).vector())
        if result.correction is not None:
            corrected.append(result.frame.index)
    places = {item.id: start.inverse().apply(item.position_m) for item in checked.end()}
    return np.array(poses), corrected, places


@fuzz
@given(st.floats(-0.05, 0.05), st.floats(0.0, 0.1), st.integers(0, 1 << 30))
def test_a_drive_about_pi_is_as_one_about_zero(off_rad, swing_rad, seed):
    poses, corrected, places = driven(SE2(), swing_rad, seed)
    turned, turned_corrected, turned_places = driven(SE2(0.0, 0.0, math.pi + off_rad), swing_rad, seed)
    assert turned_corrected == corrected
    np.testing.assert_allclose(turned, poses, atol=1e-4)
    assert turned_places.keys() == places.keys()
    for identity, at in places.items():
        np.testing.assert_allclose(turned_places[identity], at, atol=1e-4)
