"""Headings about pi: a drive is the same drive whichever way its map frame points, loop closures included."""

import math

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from support.fuzzed_room import Checked, Room, fuzz, room_camera, saved_map, slam_of

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import GrowingTrack
from edgemap.runtime.step.loop import steps

LENGTH = 100


def straight(index, swing_rad):
    """Forth and back on a line, with a heading that swings about that of the line."""
    a = index / 12.0
    return SE2(1.2 * (1.0 - math.cos(a)), 0.1 * math.sin(2.0 * a), swing_rad * math.sin(3.0 * a))


def drive(room, swing_rad, seed):
    """A camera at 10 Hz, and wheels that drift a little. room: what the pictures show."""
    wheels, odometry, random = GrowingTrack(), [SE2()], np.random.default_rng(seed)

    def drive_on(index):
        before, room.pose = room.pose, straight(index, swing_rad)
        motion = (before.inverse() @ room.pose).vector()
        odometry.append(odometry[-1] @ SE2(*(motion * 1.01 + random.normal(0.0, [2e-3, 1e-3, 2e-3]))))
        wheels.push(index / 10.0, odometry[-1])

    return room_camera(LENGTH, drive_on, wheel=wheels)


def driven(start, swing_rad, seed):
    """Poses relative to the start, stamps of corrections, and places and covariances of the objects, of one drive that
    starts at this pose of its map."""
    room = Room(seed, straight(0, swing_rad))
    camera = drive(room, swing_rad, seed)
    slam = slam_of(camera, room, False, False)
    saved = saved_map(straight(0, swing_rad), start)
    slam.mapper.start_in(saved, start)
    checked, poses, corrected = Checked(slam, saved), [], []
    for result in steps(camera, slam):
        checked(result)
        poses.append((start.inverse() @ result.pose_map_base).vector())
        if result.correction is not None:
            corrected.append(result.frame.index)
    back = start.rotation().T
    objects = {
        item.id: np.column_stack([start.inverse().apply(item.position_m), back @ item.covariance_m2 @ back.T])
        for item in checked.end()
    }
    return np.array(poses), corrected, objects


@fuzz(LENGTH, 0.5)
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
