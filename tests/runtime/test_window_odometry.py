"""Odometry of a carried camera, over a textured floor that it sees at other angles than its mount's."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.faults import kinds
from support.textured_floor import CAMERA, seen_by

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount, Platform, up_optical
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.odometry.keyframe_window import KeyframeWindow
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.estimator import EstimatedAttitude
from edgemap.runtime.motion.attitude.source import AttitudeSource
from edgemap.runtime.motion.odometry import OdometryRules, hybrid_sources
from edgemap.runtime.motion.odometry.corners import CornersRule, CornerTracker, spread
from edgemap.runtime.motion.odometry.protocol import FramePrior
from edgemap.runtime.motion.odometry.window import WindowOdometry

HEAD = FloorCamera(CAMERA.intrinsics, Mount.from_degrees(1.5, 25.0))
BLANK = np.full((240, 320, 3), 90, np.uint8)


def total(motions):
    pose = SE2()
    for motion in motions:
        pose = pose @ motion.motion
    return pose


def walked(steps, tilt=lambda index: 0.0):
    """Pictures by a lens at head height, true poses, and the lens's angles. tilt: pitch beyond the mount's, degrees."""
    pose, frames, poses, attitudes = SE2(), [], [], []
    for index, motion in enumerate([SE2(), *steps]):
        pose = pose @ motion
        pitch_rad = HEAD.mount.pitch_rad + math.radians(tilt(index))
        attitudes.append(Attitude(0.0, pitch_rad, np.eye(2) * math.radians(0.1) ** 2, source="imu"))
        poses.append(pose)
        frames.append(Frame(index, index / 10, seen_by(HEAD.at(attitudes[-1]), pose)))
    return frames, poses, attitudes


MOTIONS = {"straight": SE2(0.08), "arc": SE2(0.06, 0.0, 0.03), "back": SE2(-0.06, 0.0, 0.01), "aside": SE2(0.05, 0.05)}


@pytest.mark.parametrize("name", MOTIONS)
def test_a_carried_camera_follows_a_textured_floor(name):
    frames, poses, attitudes = walked([MOTIONS[name]] * 20)
    odometry = WindowOdometry(HEAD)
    steps = zip(frames, attitudes, strict=True)
    off = total(odometry.step(frame, {}, FramePrior(attitude)) for frame, attitude in steps).inverse() @ poses[-1]
    assert math.hypot(off.x_m, off.y_m) < 0.07  # of 1.2 to 1.6 m; until it swings it may be on wheels
    assert abs(off.yaw_rad) < 0.015


@pytest.mark.parametrize("platform", Platform)
def test_a_measured_height_takes_the_mounts_place(platform):
    frames, poses, attitudes = walked([SE2(0.08)] * 20)
    wrong = FloorCamera(HEAD.intrinsics, replace(HEAD.mount, height_m=1.25 * HEAD.mount.height_m, platform=platform))
    odometry = WindowOdometry(wrong)
    measured = [replace(seen, height_m=HEAD.mount.height_m) for seen in attitudes]
    motions = [odometry.step(frame, {}, FramePrior(seen)) for frame, seen in zip(frames, measured, strict=True)]
    assert total(motions).x_m == pytest.approx(poses[-1].x_m, rel=0.03)


def test_window_finds_the_tilt_of_a_camera_that_is_not_at_its_mounts_angles():
    frames, poses, attitudes = walked([SE2(0.08)] * 20, lambda index: 5.0 + 3.0 * math.sin(0.6 * index))
    odometry = WindowOdometry(HEAD, carried=True)
    motions = [odometry.step(frame, {}) for frame in frames]
    off = total(motions).inverse() @ poses[-1]
    assert math.hypot(off.x_m, off.y_m) < 0.12  # of 1.6 m
    up = motions[-1].rotation.up
    true = up_optical(attitudes[-1].pitch_rad, 0.0)
    assert math.degrees(math.acos(min(float(up @ true), 1.0))) < 1.5
    assert motions[-1].rotation.carried.nodding_rad > math.radians(0.3)


def test_the_windows_tilt_takes_the_place_of_the_pictures_tilt_and_they_keep_their_own():
    """Theirs is what the window takes as a prior: the window's must not come back to it."""
    source, up = EstimatedAttitude(CAMERA), up_optical(CAMERA.mount.pitch_rad + 0.1, 0.05)
    for index, (up_rad, angles) in enumerate([(0.01, (0.1, 0.05)), (0.2, (0.0, 0.0))]):
        given = source.predict(Frame(index, 0.1 * index, BLANK))
        assert given.pitch_rad == pytest.approx(CAMERA.mount.pitch_rad, abs=1e-3)
        mount = CAMERA.at(source.update(TrackedRotation(np.eye(3), up=up, up_rad=up_rad))).mount
        assert (mount.pitch_rad - CAMERA.mount.pitch_rad, mount.roll_rad) == pytest.approx(angles, abs=1e-3)


def test_a_picture_without_corners_is_a_guess_and_the_next_ones_measure_again():
    frames, _, attitudes = walked([SE2(0.08)] * 20)
    frames[10] = Frame(10, 1.0, BLANK)
    odometry = WindowOdometry(HEAD)
    motions = [odometry.step(frame, {}, FramePrior(seen)) for frame, seen in zip(frames, attitudes, strict=True)]
    assert kinds(motions[10].faults) == ["odometry"]
    assert motions[10].motion.x_m == pytest.approx(0.08, abs=0.008)
    assert np.trace(motions[10].covariance) > 30 * np.trace(motions[9].covariance)
    assert [motion.motion.x_m for motion in motions[-5:]] == pytest.approx([0.08] * 5, abs=0.01)


@pytest.mark.parametrize("lost_s", [0.1, 2.0])
@pytest.mark.parametrize("gap", [SE2(0.8, 0.0, 0.1), SE2(0.1, 0.0, 0.7), SE2(0.7, 0.1, -0.4)])
def test_a_gap_between_pictures_is_bridged_by_descriptors(gap, lost_s):
    frames, poses, attitudes = walked([SE2(0.06)] * 8 + [gap] + [SE2(0.06)] * 4)
    frames = [replace(frame, stamp_s=frame.stamp_s + lost_s * (frame.index > 8)) for frame in frames]
    odometry = WindowOdometry(HEAD)
    motions = [odometry.step(frame, {}, FramePrior(seen)) for frame, seen in zip(frames, attitudes, strict=True)]
    assert kinds(fault for motion in motions for fault in motion.faults) == []
    off = total(motions).inverse() @ poses[-1]
    assert math.hypot(off.x_m, off.y_m) < 0.04
    assert abs(off.yaw_rad) < 0.01


@pytest.mark.parametrize(("share", "sought"), [(0.25, 1), (0.4, 0)])
def test_a_pose_that_few_of_the_tracks_agree_with_is_doubted_and_descriptors_are_tried(monkeypatch, share, sought):
    """In go2_office 9 of 45 tracks over a gap of 0.7 m agreed with standing still."""
    frames, _, attitudes = walked([SE2(0.06)] * 5)
    odometry, resected, tried = WindowOdometry(HEAD), KeyframeWindow.resected, []

    def agreeing(window, start, seen, factors):
        return resected(window, start, seen, factors)[0], len(seen) * (share if frame is frames[-1] else 1.0)

    monkeypatch.setattr(KeyframeWindow, "resected", agreeing)
    monkeypatch.setattr(CornerTracker, "find_again", lambda tracker, far_px: tried.append(far_px))
    for frame, seen in zip(frames, attitudes, strict=True):
        odometry.step(frame, {}, FramePrior(seen))
    assert len(tried) == sought


@pytest.mark.parametrize(
    ("mount", "wheel", "carried"),
    [
        (Mount.from_degrees(1.64, 20.0), None, True),
        (Mount.from_degrees(0.5, 35.0), None, False),
        (Mount.from_degrees(1.64, 20.0), "wheel.csv", False),
        (Mount(1.64, math.radians(5.0), platform=Platform.CAR), None, False),
    ],
)
def test_a_camera_at_head_height_without_wheels_begins_as_a_carried_one(mount, wheel, carried):
    source = SimpleNamespace(info=CameraInfo("made", wheel=wheel))
    pictures = hybrid_sources(source, FloorCamera(CAMERA.intrinsics, mount), False, OdometryRules())["camera"]
    assert pictures.judged.carried == carried


def test_an_imus_tilt_gives_way_to_one_that_the_window_knows_better():
    """It is not given back to the IMU's filter, whose attitude the window takes as a prior."""
    given = Attitude(0.1, HEAD.mount.pitch_rad + 0.1, np.eye(2) * 0.03**2, source="imu")
    source = AttitudeSource(lambda _: given)
    up = up_optical(HEAD.mount.pitch_rad, 0.0)
    for up_rad, pitch_rad in ((0.01, HEAD.mount.pitch_rad), (0.05, given.pitch_rad)):
        camera = HEAD.at(source.update(TrackedRotation(np.eye(3), up=up, up_rad=up_rad)))
        assert camera.mount.pitch_rad == pytest.approx(pitch_rad)
        assert camera.attitude.source == "imu"


def test_a_camera_that_begins_to_sway_counts_as_carried():
    """It nods by 1.5 degrees a picture, 15 a second; no motion is counted twice or left out."""
    frames, poses, attitudes = walked([SE2(0.06)] * 24, lambda index: 2.5 * math.sin(0.7 * index))
    tracked = WindowOdometry(HEAD)
    used, motions = [], []
    for frame, seen in zip(frames, attitudes, strict=True):
        used.append(tracked.judged.carried)
        motions.append(tracked.step(frame, {}, FramePrior(seen)))
    assert not used[0]
    assert used[-1]
    assert sorted(used) == used
    assert not any(motion.blind for motion in motions)
    assert total(motions).x_m == pytest.approx(poses[-1].x_m, abs=0.08)


@pytest.mark.parametrize("floor", [0.0, 0.5])
def test_corners_that_no_floor_gives_are_sought_elsewhere(floor):
    rng, rule = np.random.default_rng(0), CornersRule()
    tracker = CornerTracker(CAMERA, rule)
    noise = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)
    seen = np.repeat([[0.0], [1.0]], [round(60 * (1 - floor)), round(60 * floor)], axis=0).repeat(80, axis=1)
    mask = FloorMask(seen.astype(np.float32), 320, 240)
    tracker.take(Frame(0, 0.0, noise), np.zeros((0, 4)), math.inf, CAMERA, mask)
    tracker.seek(0.0, False)
    assert len(tracker.corners) == rule.corners
    assert (tracker.tracks().floor >= 0.5).sum() == (floor > 0.0) * round(rule.floor_share * rule.corners)


def test_corners_that_were_covered_are_found_again_by_an_earlier_picture():
    """A hand before the left half; where they are expected is 1 px off, that of a few by 20 px."""
    frames, poses, _ = walked([SE2(0.01)] * 2)
    covered = frames[1].image.copy()
    covered[:, :160] = 90
    tracker, nobody = CornerTracker(HEAD, CornersRule()), np.zeros((0, 4))
    for number, frame in enumerate([frames[0], replace(frames[1], image=covered), frames[2]]):
        tracker.take(frame, nobody, 0.1, HEAD, None)
        if number == 0:
            tracker.seek(0.0, True)
            tracker.keep([0])
            corners, ids = tracker.corners, tracker.ids
        else:
            tracker.follow(tracker.corners, False, False)
    lost = ~np.isin(ids, tracker.ids)
    there = poses[2].inverse().apply(HEAD.floor_points(corners[lost]))
    camera = HEAD.mount.rotation_base_optical(), HEAD.mount.position_base_m()
    true = HEAD.intrinsics.project((np.column_stack([there, np.zeros(len(there))]) - camera[1]) @ camera[0])
    expected = (true + [1.0, 0.0]).astype(np.float32)
    expected[:5] += 20.0
    found = tracker.find_lost(ids[lost], np.zeros(lost.sum(), dtype=np.intp), expected, expected, 2.5, False)
    right = np.isin(ids[lost], found)
    assert lost.sum() > 40
    assert right[5:].mean() > 0.8
    assert not right[:5].any()
    np.testing.assert_array_equal(tracker.ids[-len(found) :], found)
    off = tracker.corners[-len(found) :] - true[right]
    assert np.abs(off).max() < 0.5


@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(0, 20))
def test_corners_are_spread_and_the_strongest_is_kept(seed, count, kept):
    rng = np.random.default_rng(seed)
    detected, others = (rng.uniform(0.0, 300.0, (size, 2)).astype(np.float32) for size in (60, kept))
    chosen = spread(detected, others, count)
    assert len(chosen) == min(count, len(detected))
    rows = [np.flatnonzero((detected == corner).all(axis=1))[0] for corner in chosen]
    assert rows == sorted(set(rows))
    if not kept:
        assert rows[0] == 0
    before = [np.vstack([detected[:row], others]) - detected[row] for row in range(60)]
    distance = [np.linalg.norm(apart, axis=1).min(initial=np.inf) for apart in before]
    left = [distance[row] for row in range(60) if row not in rows]
    assert not left or max(left) <= min(distance[row] for row in rows) + 1e-3
