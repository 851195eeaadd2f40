"""Attitude from pictures alone: edges and the odometry's tilt, and a real walk."""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.edges import room_edges

import edgemap
from edgemap.evaluation.trajectory import attitude_figures
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude

WALK = Path(os.environ.get("EDGEMAP_SHARED", "../shared")) / "data" / "hololens"
MOUNT = Mount.from_degrees(1.7, 20.0)


def test_edges_of_the_room_show_up_in_the_frame_before_while_the_camera_turns():
    source, rng, turn = PicturesAttitude(MOUNT), np.random.default_rng(1), small_rotation(0.03, 0.02, 0.1)
    up, rotation = up_optical(MOUNT.pitch_rad, 0.0), TrackedRotation(turn, Carried().certain())
    for index in range(2):
        source.predict(index / 10.0)
        source.begin_edges()
        source.update(rotation)
        begun = Attitude.of_up(turn.T @ up, np.zeros((2, 2)), "truth")
        source.predict(index / 10.0 + 0.05)
        source.update(rotation)
        up = turn.T @ turn.T @ up
        assert source.seen_up is None
        pitch_deg, roll_deg = np.degrees([begun.pitch_rad, begun.roll_rad]).tolist()
        assert source.see_edges(*room_edges(pitch_deg, roll_deg, rng)) is not None
        assert np.linalg.norm(np.cross(source.seen_up, up)) < math.radians(1.0)


def test_a_carried_camera_has_the_tilt_of_the_odometry_and_a_mounted_one_begins_each_frame_at_its_mount():
    source, up = PicturesAttitude(MOUNT), up_optical(math.radians(30.0), math.radians(5.0))
    assert source.predict(0.0).source == "mount"
    tracked = TrackedRotation(np.eye(3), Carried(), up=up, up_rad=math.radians(0.5))
    assert math.degrees(source.update(tracked).pitch_rad) == pytest.approx(30.0)
    mounted = source.predict(0.1)
    assert mounted.source == "mount"
    assert math.degrees(mounted.pitch_rad) == pytest.approx(20.0)
    source.update(replace(tracked, carried=Carried().certain()))
    carried, later = source.predict(0.2), source.predict(0.3)
    assert math.degrees(carried.roll_rad) == pytest.approx(5.0)
    assert later.covariance_rad2[0, 0] > carried.covariance_rad2[0, 0] > math.radians(0.5) ** 2
    source.update(replace(tracked, up_rad=math.radians(5.0)))
    assert source.predict(0.7).source == "mount"  # too uncertain to show that the mount's angles are wrong


@pytest.mark.skipif(not WALK.is_dir(), reason=f"{WALK}: no recorded walk")
def test_a_real_walk_is_seen_level_without_an_imu():
    drive = open_drive(f"c2w:{WALK}")
    camera = drive_camera(replace(drive, depth=()), f"c2w:{WALK}")
    with edgemap.open(camera, "edgemap-pico", odometry="window") as session:
        found = [step.observed.camera.attitude for step, _ in zip(session, range(80), strict=False)]
    true = [drive.attitudes.at(stamp_s, MOUNT.height_m) for stamp_s in drive.stamps_s[:80]]
    mount = attitude_figures([Attitude.of_mount(drive.mount)] * 45, true[35:])
    told = [(own, level) for own, level in zip(found[35:], true[35:], strict=True) if own.source == "pictures"]
    assert len(told) > 40  # of 45; the others are the mount's
    figures = attitude_figures(*zip(*told, strict=True))
    assert figures["pitch_rms_deg"] < 0.3 * mount["pitch_rms_deg"]
    assert 0.15 < figures["nees"] < 6.0  # 0.33
