"""Odometry by keyframes with depth, over a textured floor: holes, turns, what covers the lens, and depth that ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.textured_floor import CAMERA, MOTIONS, drive

from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.depth import DepthOdometry
from edgemap.runtime.motion.odometry.depth_keyframes import DepthRule, patch_depths
from edgemap.runtime.motion.odometry.planar import PlanarOdometry

V, U = np.mgrid[0:240, 0:320]
DEPTH = np.nan_to_num(CAMERA.optical_depth_m(CAMERA.floor_points(np.column_stack([U.ravel(), V.ravel()]))))
DEPTH = np.where(DEPTH < 6.0, DEPTH, 0.0).reshape(240, 320).astype(np.float32)


def with_holes(share, seed=0):
    """The floor's depth, where blocks of 8 px are missing."""
    kept = np.random.default_rng(seed).uniform(size=(30, 40)) >= share
    return np.where(np.kron(kept, np.ones((8, 8), bool)), DEPTH, 0.0).astype(np.float32)


def odometry():
    return DepthOdometry(CAMERA, PlanarOdometry(CAMERA))


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
    assert apart_m < 0.035
    assert apart_rad < 0.02
    assert all(motion.measured for motion in found[1:])


def test_a_covered_lens_costs_its_own_pictures_and_not_the_drive():
    frames, poses = drive(MOTIONS["left arc"])
    frames = [replace(f, depth=DEPTH) for f in frames]
    dark = np.zeros_like(frames[0].image)
    frames = [replace(f, image=dark) if f.index in (8, 9) else f for f in frames]
    source, pose = odometry(), SE2()
    for frame in frames:
        motion = source.step_blind(frame.stamp_s, "covered") if frame.image is dark else source.step(frame, {})
        pose = pose @ motion.motion
    apart_m, apart_rad = off(pose, poses[-1])
    assert apart_m < 0.035
    assert apart_rad < 0.02


def test_depth_that_ends_leaves_planar_odometry():
    frames, poses = drive(MOTIONS["straight"])
    pose, found = followed([replace(f, depth=DEPTH) if f.index < 10 else f for f in frames])
    assert sum(motion.blind for motion in found) == 0
    assert off(pose, poses[-1])[0] < 0.04


def test_a_picture_that_depth_cannot_locate_is_followed_by_planar_odometry():
    frames, poses = drive(MOTIONS["straight"])
    blank = np.zeros_like(DEPTH)
    pose, found = followed([replace(f, depth=DEPTH if f.index < 8 else blank) for f in frames])
    assert all(motion.measured for motion in found[1:])
    assert off(pose, poses[-1])[0] < 0.04


def test_the_number_of_keyframes_is_bounded():
    frames, _ = drive(MOTIONS["spin right"])
    source = DepthOdometry(CAMERA, PlanarOdometry(CAMERA), DepthRule(kept=4))
    followed([replace(f, depth=DEPTH) for f in frames], source)
    assert len(source.keyframes) == 4


def test_depth_of_a_patch_by_hand():
    depth = np.zeros((20, 20), np.float32)
    depth[:, :10], depth[:, 10:] = 2.0, 4.0
    depth[8:10, 2:4] = 2.1
    depth[:3] = np.nan
    points = np.array([[4.0, 9.0], [10.0, 9.0], [16.0, 12.0], [10.0, 1.0]])
    found, spread = patch_depths(depth, points, half_px=2, flat=0.06)
    assert found[0] == pytest.approx(2.0)
    assert spread[2] == pytest.approx(0.0)
    assert math.isnan(found[1])  # an edge between two depths
    assert found[2] == pytest.approx(4.0)
    assert math.isnan(found[3])  # too few are known
