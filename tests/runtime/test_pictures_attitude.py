"""Attitude from pictures alone: a carried camera and a nodding robot by made rotations, and a real walk."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import math
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.edges import room_edges

import edgemap
from edgemap.evaluation.trajectory import attitude_figures
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.inertial import rotation_of
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude

WALK = Path(os.environ.get("EDGEMAP_SHARED", "../shared")) / "data" / "hololens"
MOUNT = Mount.from_degrees(1.7, 20.0)
BLANK = np.zeros((4, 4, 3), np.uint8)


def swinging(pitches_deg, rolls_deg, yaws_deg):
    """Rotations (N, 3, 3) of optical directions into a level frame of a camera that swings so."""
    return [
        rotation_of(np.array([[0.0, 0.0, math.radians(yaw)]]))[0]
        @ Mount.from_degrees(1.0, pitch, roll).rotation_base_optical()
        for pitch, roll, yaw in zip(pitches_deg, rolls_deg, yaws_deg, strict=True)
    ]


def followed(poses, noise_rad, edges_every=None):
    """The attitudes of cameras (rotations as of `swinging`) at 10 Hz, and the true ones."""
    source, rng = PicturesAttitude(MOUNT), np.random.default_rng(1)
    found, true, carried = [], [], Carried()
    for index, (before, now) in enumerate(pairwise([poses[0], *poses])):
        attitude = Attitude.of_up(now[2], np.zeros((2, 2)), "truth")
        source.predict(index / 10.0)
        if edges_every and index % edges_every == 0:
            source.begin_edges()
        rotation = before.T @ now @ rotation_of(rng.normal(0.0, noise_rad, (1, 3)))[0]
        carried = carried.updated(float(((now[2] - before[2]) ** 2).sum()) / 2.0, 0.1, 0.0)
        found.append(source.update(TrackedRotation(rotation, noise_rad, carried) if index else None))
        true.append(attitude)
        if edges_every and index % edges_every == 0:
            pitch_deg, roll_deg = np.degrees([attitude.pitch_rad, attitude.roll_rad]).tolist()
            source.see_edges(*room_edges(pitch_deg, roll_deg, rng))
    return found, true


def test_a_carried_camera_far_off_its_mount_is_found_by_the_edges_of_the_room():
    stamps = np.arange(80) / 10.0
    pitches, rolls = 8.0 + 8.0 * np.sin(2.0 * stamps), 6.0 + 3.0 * np.sin(3.0 * stamps)
    found, true = followed(swinging(pitches, rolls, 20.0 * stamps), math.radians(0.2), edges_every=3)
    figures = attitude_figures(found[20:], true[20:])
    assert max(figures["pitch_rms_deg"], figures["roll_rms_deg"]) < 0.7
    assert 0.2 < figures["nees"] < 4.0  # 0.38: it states a little more than it errs
    assert figures["sources"] == {"pictures": 1.0}
    blank, _ = followed(swinging(pitches, rolls, 20.0 * stamps), math.radians(0.2))
    assert {attitude.source for attitude in blank[5:]} == {"mount"}  # no edges: nothing tells where up is


def test_a_nodding_robot_is_followed_about_its_mount():
    rng = np.random.default_rng(0)
    nods = np.convolve(rng.normal(size=300), np.exp(-np.arange(8) / 3.0), "same") * 0.3
    poses = swinging(20.0 + nods, np.zeros(300), np.cumsum(rng.normal(0.0, 2.0, 300)))
    figures = attitude_figures(*followed(poses, math.radians(0.05)))
    assert figures["pitch_rms_deg"] < 0.9 * np.sqrt((nods**2).mean())
    assert 0.5 < figures["nees"] < 4.0


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
