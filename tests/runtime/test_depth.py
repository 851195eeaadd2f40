"""Depth as one more observation: attitude and height by the floor, ranges of boxes, motion with and without holes."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from support.depth_room import LENS, depth_room
from support.faults import made
from support.textured_floor import CAMERA, MOTIONS, drive, seen_by

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import FloorRule, sightings_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.estimator import DepthAttitude, EstimatedAttitude
from edgemap.runtime.motion.height_check import HeightCheck
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion
from edgemap.runtime.motion.odometry.window import WindowOdometry

MOUNT = Mount.from_degrees(0.5, 15.0)
BLANK = np.zeros((480, 640, 3), np.uint8)


OTHER = Attitude(0.0, MOUNT.pitch_rad, np.eye(2) * 1e-4, rotation=GyroRotation(np.eye(3), 0.1, 0.01))


def by_depth(depth):
    """The attitude of one frame, beside another source's."""
    return DepthAttitude(FloorCamera(LENS, MOUNT), math.radians(0.2)).predict(Frame(0, 0.0, BLANK, depth=depth), OTHER)


@pytest.mark.parametrize(("pitch_deg", "roll_deg", "rise_m"), [(0.0, 0.0, 0.0), (3.0, -2.0, 0.03), (-3.0, 1.0, -0.02)])
def test_the_floor_tells_attitude_and_height_beside_a_wall_and_a_table(pitch_deg, roll_deg, rise_m):
    depth = depth_room(Mount.from_degrees(0.5 + rise_m, 15.0 + pitch_deg, roll_deg), noise=0.005)
    found = by_depth(depth)
    assert found.source == "depth"
    assert math.degrees(found.pitch_rad) == pytest.approx(15.0 + pitch_deg, abs=0.1)
    assert math.degrees(found.roll_rad) == pytest.approx(roll_deg, abs=0.1)
    assert found.height_m == pytest.approx(0.5 + rise_m, abs=0.003)
    assert found.rotation is OTHER.rotation
    assert np.degrees(np.sqrt(np.diag(found.covariance_rad2))).max() < 0.3


def test_a_nodding_camera_is_followed_farther_than_it_would_be_found():
    source = DepthAttitude(FloorCamera(LENS, MOUNT), math.radians(0.2))
    for index in range(8):  # a degree and a half a picture
        depth = depth_room(Mount.from_degrees(0.5, 15.0 + 1.5 * index))
        found = source.predict(Frame(index, index / 10, BLANK, depth=depth), OTHER)
    assert math.degrees(found.pitch_rad) == pytest.approx(25.5, abs=0.1)


@pytest.mark.parametrize(
    "depth",
    [
        None,
        *(np.full((480, 640), value, np.float32) for value in (0.0, np.nan, 1.5)),  # the last one is a wall
        np.random.default_rng(0).uniform(0.2, 5.0, (480, 640)).astype(np.float32),
        depth_room(Mount.from_degrees(0.25, 15.0)),  # a plane a quarter of a metre higher, and nothing below
    ],
)
def test_depth_that_shows_no_floor_changes_nothing(depth):
    assert by_depth(depth) is OTHER


def faults_of(mounted, believed=MOUNT, frames=45):
    """Of a camera that nods a little on its mount, 4 pictures a second."""
    camera = FloorCamera(LENS, believed)
    source = EstimatedAttitude(camera)
    check, none = HeightCheck(believed), Detections.none(("chair",))
    faults = []
    for index in range(frames):
        nod = Mount(mounted.height_m, mounted.pitch_rad + math.radians(0.4) * math.sin(index), mounted.roll_rad)
        frame = Frame(index, index / 4, BLANK, depth=depth_room(nod))
        attitude = source.predict(frame)
        faults += [*source.faults, check.judge(frame.stamp_s, camera.at(attitude), none, Motion())]
    return [fault for fault in faults if fault]


def test_a_mount_that_depth_shows_to_be_wrong_is_a_fault_once_and_a_right_one_is_none():
    assert not faults_of(Mount.from_degrees(0.52, 15.5, 0.4))
    (fault,) = faults_of(Mount.from_degrees(0.6, 15.0))
    assert fault.kind is FaultKind.MOUNT_HEIGHT
    assert fault.text.startswith("mount: height 0.50 m given, the floor in depth pictures would make it 0.60 m, to 2 %")
    (fault,) = faults_of(Mount.from_degrees(0.5, 19.0))
    by_floor = r"mount: pitch 15.0 and roll 0.0 deg given, the floor in depth pictures give pitch 1[89]\."
    assert re.match(by_floor, fault.text)


LEVEL = FloorCamera(LENS, Mount(1.0, 0.0, 0.0, 0.2, 0.0))


def floor_depth(camera, farthest_m=math.inf):
    """The depth picture of a bare floor up to there."""
    v, u = np.mgrid[0:240, 0:320]
    points = camera.floor_points(np.column_stack([u.ravel(), v.ravel()]))
    depth = np.nan_to_num(camera.optical_depth_m(points)).reshape(240, 320).astype(np.float32)
    return np.where(depth < farthest_m, depth, 0.0)


def fridge(lower_edge):
    box = np.array([[300.0, 60.0, 342.0, lower_edge]])
    return Detections(box, np.array([0.9]), np.zeros(1, int), ("refrigerator",))


def sighted(boxes, depth):
    (found,) = sightings_of(boxes, LEVEL, FloorRule(), depth=depth)
    return found


def test_the_range_of_a_box_corrects_where_its_lower_edge_stands():
    """Its lower edge 123.08 px below the horizon means 5 m; a face seen at 4.5 m lies 0.155 m (half of 0.31) behind it,
    known to 0.19 m where the edge (0.4 % of 640 px, 2 % of the box, 0.3 degrees) is known to 0.2."""
    plain, wall = sighted(fridge(363.28), None), np.full((480, 640), 4.5, np.float32)
    seen = sighted(fridge(363.28), wall)
    assert plain.position_base_m[0] == pytest.approx(0.2 + 5.0 + 0.31, abs=0.01)
    assert 0.2 + 4.5 + 0.155 < seen.position_base_m[0] < plain.position_base_m[0] - 0.2
    assert seen.covariance_m2[0, 0] < plain.covariance_m2[0, 0]
    assert seen.position_base_m[1] == pytest.approx(plain.position_base_m[1], abs=0.01)


@pytest.mark.parametrize("value", [0.0, np.nan, 30.0])
def test_boxes_of_unknown_depth_stay_where_they_are(value):
    depth = np.full((480, 640), value, np.float32)
    plain, seen = sighted(fridge(363.28), None), sighted(fridge(363.28), depth)
    assert (seen.position_base_m == plain.position_base_m).all()
    assert (seen.covariance_m2 == plain.covariance_m2).all()


def test_corners_keep_the_scale_by_depth_where_the_height_is_wrong():
    """A lens at 0.5 m that is believed at 0.65 m: 30 % too far without depth. By depth the length is that of the right
    height, too short on this floor, whose large blobs pull corners (`test_keyframe_window` has exact corners)."""
    frames, poses = drive(MOTIONS["straight"])
    believed = FloorCamera(CAMERA.intrinsics, Mount.from_degrees(0.65, 15.0, 0.0, 0.12))
    lengths = {}
    for given in (None, floor_depth(CAMERA)):
        odometry, pose = WindowOdometry(believed), SE2()
        for frame in frames:
            pose = pose @ odometry.step(Frame(frame.index, frame.stamp_s, frame.image, depth=given), {}).motion
        lengths[given is None] = pose.x_m / poses[-1].x_m
    assert lengths[True] == pytest.approx(1.3, abs=0.1)
    assert lengths[False] == pytest.approx(1.0, abs=0.07)


def test_planar_follows_a_camera_that_nods_by_the_floor_in_its_depth():
    """Three degrees up and down over a second, and nobody tells but the depth."""
    _, poses = drive(MOTIONS["straight"])
    source, odometry, pose = EstimatedAttitude(CAMERA), WindowOdometry(CAMERA), SE2()
    for index, true in enumerate(poses):
        tilt = math.radians(3.0) * math.sin(0.6 * index)
        camera = CAMERA.at(Attitude(0.0, CAMERA.mount.pitch_rad + tilt, np.zeros((2, 2))))
        frame = Frame(index, index / 10, seen_by(camera, true), depth=floor_depth(camera, 6.0))
        attitude = source.predict(frame)
        assert attitude.source == "depth"
        pose = pose @ odometry.step(frame, {}, FramePrior(attitude)).motion
    off = pose.inverse() @ poses[-1]
    assert math.hypot(off.x_m, off.y_m) < 0.04
    assert abs(off.yaw_rad) < 0.02


DEPTH = floor_depth(CAMERA, 6.0)
NO_DEPTH = np.zeros_like(DEPTH)


def with_holes(share, seed):
    """The floor's depth, where blocks of 8 px are missing."""
    kept = np.random.default_rng(seed).uniform(size=(30, 40)) >= share
    return np.where(np.kron(kept, np.ones((8, 8), bool)), DEPTH, 0.0).astype(np.float32)


DEPTHS = {  # of the frame with this number
    "whole": lambda index: DEPTH,
    "with holes": lambda index: with_holes(0.5, index),
    "ends": lambda index: DEPTH if index < 10 else None,
    "is blank": lambda index: DEPTH if index < 8 else NO_DEPTH,
    "now and then": lambda index: DEPTH if index % 2 == 0 else None,
    "covered": lambda index: DEPTH,  # the lens, too, in pictures 8 and 9
}
MOVED = [(name, depth, 0.055) for name in MOTIONS for depth in ("whole", "with holes")]  # m off, of 0.8 m
MOVED += [("straight", "ends", 0.055), ("straight", "is blank", 0.055), ("left arc", "now and then", 0.035)]
MOVED += [("left arc", "covered", 0.055)]


@pytest.mark.parametrize(("name", "depth", "most_m"), MOVED)
def test_motion_by_depth_that_has_holes_ends_or_comes_now_and_then(name, depth, most_m):
    """Large blobs pull corners. A covered lens costs its own pictures and not the drive."""
    frames, poses = drive(MOTIONS[name])
    source, pose = WindowOdometry(CAMERA), SE2()
    for frame in frames:
        covered, seen = depth == "covered" and frame.index in (8, 9), replace(frame, depth=DEPTHS[depth](frame.index))
        motion = source.step_blind(frame.stamp_s, made("covered")) if covered else source.step(seen, {})
        assert motion.measured or frame.index == 0 or depth == "covered"
        pose = pose @ motion.motion
    apart = pose.inverse() @ poses[-1]
    assert math.hypot(apart.x_m, apart.y_m) < most_m
    assert abs(apart.yaw_rad) < 0.02
