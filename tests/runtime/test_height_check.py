"""A mount's height is checked by what stands on the floor, and by the wheels; one that was guessed is corrected."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.attitude import Attitude, MountEstimate
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.height_check import HeightCheck
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.outputs.verdict.causes import CAUSES, cause_of
from edgemap.runtime.step.slam import SlamOptions, build_slam

LENS = Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
NAMES = ("chair", "tv")


def chair(camera, away_m, label=0, height_m=0.85, depth_m=0.5):
    """The box of an upright thing whose near side stands straight ahead."""
    corners = [(x, y, z) for x in (away_m, away_m + depth_m) for y in (-0.25, 0.25) for z in (0.0, height_m)]
    pixels = camera.project(corners) + 0.5
    box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    return Detections(box[None], np.array([0.9]), np.array([label]), NAMES)


@pytest.mark.parametrize(("given", "wrong"), [(0.4, True), (0.6, False)])
def test_the_demo_with_a_wrong_height_is_a_fault_that_names_the_likelier_one(demo, given, wrong):
    floor, faults, heights = (
        FloorCamera(demo.camera.info.intrinsics, replace(demo.camera.info.mount, height_m=given)),
        [],
        [],
    )
    slam = build_slam(demo.camera, demo.bundle, floor, SlamOptions(wheels=False))
    for index, (image, stamp_s) in enumerate(zip(demo.images, demo.stamps_s, strict=True)):
        if stamp_s > 12.0 or faults:
            break
        observed = slam.step(Frame(index, stamp_s, image)).observed
        faults = [fault for fault in observed.faults if fault.kind is FaultKind.MOUNT_HEIGHT]
        heights += [observed.height_estimate] if observed.height_estimate else []
    assert bool(faults) == wrong
    assert heights[-1].height_m == pytest.approx(0.6, abs=max(0.06, 2.0 * heights[-1].sigma_m))
    if wrong:
        assert float(re.search(r"would make it (\S+) m", faults[0].text)[1]) == pytest.approx(0.6, abs=0.06)


def by_wheels(scale, count=300, sigma_m=0.0005, slip=0, boxes=None):
    """Faults of a robot that rolls 5 cm a step and whose camera measures `scale` times that; the last steps slip."""
    random, mount = np.random.default_rng(0), Mount(0.6, 0.1)
    camera, check, faults = FloorCamera(LENS, mount), HeightCheck(mount), []
    for index in range(count):
        rolled_m = 0.05 * (2.0 if index >= count - slip else 1.0)
        lengths = 0.05 * scale + random.normal(0.0, sigma_m), rolled_m
        motion = Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-6, lengths=lengths)
        fault = check.judge(index / 10.0, camera, Attitude.of_mount(mount), boxes or Detections.none(NAMES), motion)
        faults += [(index / 10.0, fault)] if fault else []
    return faults


@pytest.mark.parametrize(("scale", "height"), [(1.4, "0.43"), (0.7, "0.86")])
def test_wheels_name_the_likelier_height_once(scale, height):
    ((stamp_s, fault),) = by_wheels(scale)
    assert stamp_s <= 12.0
    assert f"height 0.60 m given, the wheels would make it {height} m" in fault.text
    assert cause_of(fault.kind) is CAUSES["scale"]  # what `edgemap why` makes of it


def test_wheels_that_agree_or_scatter_or_slip_for_a_moment_say_nothing_of_the_height():
    assert not by_wheels(1.0)
    assert not by_wheels(1.1)
    assert not by_wheels(1.0, slip=12)
    assert not by_wheels(1.15, sigma_m=0.01)
    assert not by_wheels(-1.0)


@pytest.mark.parametrize(("true", "height"), [(1.1, None), (1.4, "0.9[0-9]")])
def test_wheels_are_wrong_where_objects_are_nearer_to_the_given_height(true, height):
    """Wheels that would make the lens 1.6 times as high, and chairs as a lens `true` times as high sees them."""
    found = by_wheels(1.0 / 1.6, boxes=chair(FloorCamera(LENS, Mount(0.6 * true, 0.1)), 2.5))
    assert len(found) == (height is not None)
    if height is not None:
        assert re.search(f"usual height of chair and the wheels would make it {height} m", found[0][1].text)


# A lens 0.6 m up that is taken for 0.72 m, and what it sees.
TAKEN, BOXES = Mount(0.72, 0.1), chair(FloorCamera(LENS, Mount(0.6, 0.1)), 2.5)
BY_SIZES = 0.6 / 0.72


def seen(check, indices, boxes=BOXES, mount=TAKEN, attitude=None, **measured):
    """Judges so many frames, ten a second, which are no fault. measured: motion, depth."""
    for index in indices:
        given = {"motion": Motion()} | measured
        told = attitude or Attitude.of_mount(mount)
        assert not check.judge(index / 10, FloorCamera(LENS, mount), told, boxes, **given)


@pytest.mark.parametrize("guessed", [0.0, 0.3])
def test_a_guess_moves_to_the_sizes_of_objects_and_a_given_height_never(guessed):
    """The sizes (13 %) weigh five times as much as a guess of 30 %."""
    check = HeightCheck(TAKEN, guessed=guessed)
    seen(check, range(200))
    assert check.scale == (pytest.approx(BY_SIZES, abs=0.04) if guessed else 1.0)
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_wheels_measure_the_path_so_its_scale_stays():
    check = HeightCheck(TAKEN, guessed=0.3)
    seen(check, range(200), motion=Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-6, lengths=(0.06, 0.05)))
    assert check.scale == 1.0
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.02)


@pytest.mark.parametrize("measured", [{"depth": True}, {"motion": Motion(lengths=(0.0, 0.0))}])
@pytest.mark.parametrize("begins", [0, 150])
def test_a_robot_that_turns_in_place_has_wheels_or_depth_all_the_same(measured, begins):
    """The path is measured from then on, whatever the sizes have shown: 50 cm rolled are not waited for."""
    check = HeightCheck(TAKEN, guessed=0.3)
    for index in range(200):
        seen(check, [index], **(measured if index >= begins else {}))
        assert (check.scale == 1.0) == (index < 100 or index >= begins)
    assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)


def test_a_correction_of_the_mount_keeps_the_sizes_of_a_guess():
    """Pitch 3 degrees too steep for 20 s, then right, and no box more: the boxes so far give the scale by the right
    pitch. A given height is judged by boxes after the correction alone."""
    steep = replace(TAKEN, pitch_rad=0.1 + math.radians(3.0))
    estimate = MountEstimate(TAKEN, np.full(2, 0.005), TAKEN, steep)
    corrected = replace(Attitude.of_mount(TAKEN), mount=estimate)
    for guessed in (0.3, 0.0):
        check = HeightCheck(steep, guessed=guessed)
        seen(check, range(200), mount=steep)
        wrong = check.estimate
        assert wrong.height_m > 0.66
        seen(check, range(200, 400), Detections.none(NAMES), attitude=corrected)
        if guessed:
            assert check.scale == pytest.approx(BY_SIZES, abs=0.04)
            assert check.estimate.height_m == pytest.approx(0.6, abs=0.03)
        else:
            assert check.estimate is wrong
