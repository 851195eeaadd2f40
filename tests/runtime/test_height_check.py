"""A mount's height is checked without wheels or depth: by what stands on the floor, and by the accelerometer."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false, reportOptionalSubscript=false
# pyright: reportGeneralTypeIssues=false

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.acceleration_scale import MovedStep, accelerations, scale_of
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import lens_heights
from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import load_bundle
from edgemap.runtime.cameras import open_camera
from edgemap.runtime.frame import Frame
from edgemap.runtime.height_check import HeightCheck
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.session import SlamOptions, build_slam
from edgemap.runtime.store import bundle_folder

LENS = Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
NAMES = ("chair", "vase")


def chair(camera, away_m, label=0, height_m=0.87, depth_m=0.5):
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


def robot(scale, noise, hz=10.0, seconds=30.0, seed=0):
    """Steps of a robot that speeds up, brakes and turns, its lens 0.2 m ahead; odometry's velocities by this scale."""
    random, steps = np.random.default_rng(seed), []
    arm = np.array([0.2, -0.05])
    for t in np.arange(0.0, seconds, 1.0 / hz):
        v, dv = 0.4 + 0.3 * math.sin(0.9 * t), 0.27 * math.cos(0.9 * t)
        w, dw = 0.8 * math.sin(0.5 * t), 0.4 * math.cos(0.5 * t)
        force = np.array([dv - dw * arm[1] - w * w * arm[0], v * w + dw * arm[0] - w * w * arm[1]])
        force += [0.4, -0.3] + random.normal(0.0, noise, 2)
        steps.append(MovedStep(1.0 / hz, force, w, scale * np.array([v, 0.0]) + random.normal(0.0, noise / 4.0, 2)))
    return steps, arm


@pytest.mark.parametrize("hz", [5.0, 10.0, 30.0])
@pytest.mark.parametrize("scale", [0.67, 1.0, 1.5])
def test_an_accelerometer_tells_the_scale_of_odometry(scale, hz):
    steps, arm = robot(scale, 0.04, hz)
    count = round(1.2 * hz)
    pairs = [accelerations(steps[at : at + count], 0.3, arm) for at in range(0, len(steps) - count, count // 2)]
    log_scale, sigma = scale_of(np.array(pairs))
    assert math.exp(log_scale) == pytest.approx(1.0 / scale, rel=0.08)
    assert sigma < 0.1


def test_a_robot_that_does_not_accelerate_tells_no_scale():
    still = [MovedStep(0.1, np.array([0.4, 0.0]), 0.0, np.array([0.3, 0.0]))] * 12
    assert scale_of(np.array([accelerations(still, 0.3, np.zeros(2))] * 20)) is None


def told(scale, members):
    """The fault of a check whose frames bring an IMU and odometry by this scale, no boxes."""
    steps, arm = robot(scale, 0.04)
    mount = Mount(0.5, 0.1, 0.0, *arm)
    camera, check = FloorCamera(LENS, mount), HeightCheck(mount)
    to_optical = mount.rotation_base_optical().T
    for index, step in enumerate(steps):
        stamp_s, covariance = index / 10.0, np.diag([1e-5, 1e-5, 1e-6])
        imu = ImuSamples(
            np.array([stamp_s]),
            (to_optical @ [0.0, 0.0, step.yaw_rate])[None],
            (to_optical @ [*step.force, 9.81])[None],
        )
        frame = Frame(index, stamp_s, np.zeros((2, 2, 3), np.uint8), imu=imu, attitude=Attitude.of_mount(mount))
        x_m, y_m = (step.velocity / 10.0).tolist()
        motion = Motion(SE2(x_m, y_m, step.yaw_rate / 10.0), covariance, members=members)
        if fault := check.judge(frame, camera, Detections.none(NAMES), motion):
            return stamp_s, fault
    return None


def test_the_accelerometer_alone_names_a_wrong_height_unless_wheels_measure_the_motion():
    stamp_s, fault = told(0.667, {"planar": "used"})
    assert stamp_s < 20.0
    assert "the accelerometer would make it" in fault
    assert float(re.search(r"would make it (\S+) m", fault)[1]) == pytest.approx(0.75, rel=0.1)
    assert told(1.0, {"planar": "used"}) is None
    assert told(0.667, {"planar": "used", "wheel": "used"}) is None


@pytest.mark.parametrize(("given", "wrong"), [(0.4, True), (0.6, False), (0.9, True)])
def test_the_demo_with_a_wrong_height_is_a_fault_that_names_the_likelier_one(given, wrong):
    bundle, faults = load_bundle(bundle_folder("edgemap-nano")), []
    with open_camera("demo") as camera:
        floor = FloorCamera(camera.intrinsics, replace(camera.mount, height_m=given))
        slam = build_slam(camera, bundle, floor, SlamOptions(wheels=False))
        while (frame := camera.read()) is not None and frame.stamp_s <= 12.0 and not faults:
            faults = [fault for fault in slam.step(frame).observed.faults if "height" in fault]
    assert bool(faults) == wrong
    if wrong:
        assert float(re.search(r"would make it (\S+) m", faults[0])[1]) == pytest.approx(0.6, abs=0.06)
