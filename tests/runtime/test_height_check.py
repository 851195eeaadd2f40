"""A mount's height is checked by what stands on the floor, and by the wheels."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import lens_heights
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


@pytest.mark.parametrize(("height", "pitch_deg"), [(0.4, 0.0), (0.6, 5.0), (1.4, 20.0)])
@pytest.mark.parametrize("given", [0.5, 1.0, 1.5])
def test_a_chair_tells_the_height_of_the_lens_whatever_is_given(height, pitch_deg, given):
    camera = FloorCamera(LENS, Mount(height, math.radians(pitch_deg)))
    wrong = FloorCamera(LENS, Mount(given * height, math.radians(pitch_deg)))
    (found,) = lens_heights(chair(camera, 2.5), wrong)
    assert found.height_m == pytest.approx(height, rel=0.01)


def test_what_has_no_usual_height_or_is_cut_tells_nothing():
    camera = FloorCamera(LENS, Mount(0.6, 0.0))
    assert not lens_heights(chair(camera, 2.5, label=1), camera)
    assert not lens_heights(chair(camera, 0.9), camera)  # its foot lies below the picture


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
