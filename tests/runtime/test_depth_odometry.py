"""Tracked corners with depth, over a textured floor: holes, turns, what covers the lens, and depth that ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.faults import made
from support.textured_floor import CAMERA, MOTIONS, drive

from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.window import WindowOdometry

V, U = np.mgrid[0:240, 0:320]
DEPTH = np.nan_to_num(CAMERA.optical_depth_m(CAMERA.floor_points(np.column_stack([U.ravel(), V.ravel()]))))
DEPTH = np.where(DEPTH < 6.0, DEPTH, 0.0).reshape(240, 320).astype(np.float32)


def with_holes(share, seed=0):
    """The floor's depth, where blocks of 8 px are missing."""
    kept = np.random.default_rng(seed).uniform(size=(30, 40)) >= share
    return np.where(np.kron(kept, np.ones((8, 8), bool)), DEPTH, 0.0).astype(np.float32)


def odometry():
    return WindowOdometry(CAMERA)


def followed(frames, source=None):
    source, pose, found = source or odometry(), SE2(), []
    for frame in frames:
        found.append(source.step(frame, {}))
        pose = pose @ found[-1].motion
    return pose, found


def off(pose, true):
    apart = pose.inverse() @ true
    return math.hypot(apart.x_m, apart.y_m), abs(apart.yaw_rad)


@pytest.mark.parametrize("name", list(MOTIONS))
@pytest.mark.parametrize("holes", [0.0, 0.5])
def test_motion_by_depth_with_and_without_holes(name, holes):
    frames, poses = drive(MOTIONS[name])
    pose, found = followed([replace(f, depth=with_holes(holes, f.index)) for f in frames])
    apart_m, apart_rad = off(pose, poses[-1])
    assert apart_m < 0.055  # of 0.8 m: large blobs pull corners
    assert apart_rad < 0.02
    assert all(motion.measured for motion in found[1:])


def test_a_covered_lens_costs_its_own_pictures_and_not_the_drive():
    frames, poses = drive(MOTIONS["left arc"])
    frames = [replace(f, depth=DEPTH) for f in frames]
    dark = np.zeros_like(frames[0].image)
    frames = [replace(f, image=dark) if f.index in (8, 9) else f for f in frames]
    source, pose = odometry(), SE2()
    for frame in frames:
        motion = source.step_blind(frame.stamp_s, made("covered")) if frame.image is dark else source.step(frame, {})
        pose = pose @ motion.motion
    apart_m, apart_rad = off(pose, poses[-1])
    assert apart_m < 0.055  # of 0.8 m: large blobs pull corners
    assert apart_rad < 0.02


def test_motion_goes_on_where_depth_ends():
    frames, poses = drive(MOTIONS["straight"])
    pose, found = followed([replace(f, depth=DEPTH) if f.index < 10 else f for f in frames])
    assert sum(motion.blind for motion in found) == 0
    assert off(pose, poses[-1])[0] < 0.055


def test_depth_pictures_without_any_depth_are_followed():
    frames, poses = drive(MOTIONS["straight"])
    blank = np.zeros_like(DEPTH)
    pose, found = followed([replace(f, depth=DEPTH if f.index < 8 else blank) for f in frames])
    assert all(motion.measured for motion in found[1:])
    assert off(pose, poses[-1])[0] < 0.055


def test_depth_of_every_second_picture_is_used():
    frames, poses = drive(MOTIONS["left arc"])
    source, pose = odometry(), SE2()
    for frame in frames:
        pose = pose @ source.step(replace(frame, depth=DEPTH) if frame.index % 2 == 0 else frame, {}).motion
    assert off(pose, poses[-1])[0] < 0.035
