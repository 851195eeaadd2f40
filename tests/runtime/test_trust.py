"""Sensors whose numbers are well formed and wrong: who is named, left out, and used again."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.faults import texts
from support.inertial import MOUNT, AboutMount, level_samples
from support.odometry import MadeOdometry

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2, compose_covariance, wrap_angle
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.kinds import read_wheels
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.motion.attitude.imu_trust import ImuTrust
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry
from edgemap.runtime.motion.odometry.protocol import Motion, first_motion
from edgemap.runtime.motion.odometry.recorded import WHEEL, RecordedOdometry
from edgemap.runtime.motion.trust import TrustRule
from edgemap.runtime.step.slam import build_slam

WHEELS = Path(DEMO) / "wheel.csv"
BLANK = np.zeros((4, 4, 3), np.uint8)
SIGMAS = {"camera": (0.004, 0.004, 0.002), "wheels": (0.002, 0.002, 0.002)}
LIES = {
    "mirrored yaw": (1.0, 1.0, -1.0), "yaw by half more": (1.0, 1.0, 1.5), "frozen": (0.0, 0.0, 0.0), "backwards":
    (-1.0, -1.0, -1.0), "twice as long": (2.0, 2.0, 1.0),
}  # fmt: skip


class Noisy(MadeOdometry):
    """Measures the motions given, with the noise that it states."""

    def __init__(self, name, source, motions, seed=0):
        random = np.random.default_rng(seed)
        self.name, self._sigmas = name, np.array(SIGMAS[source])
        told = np.array(motions) + random.normal(0.0, 1.0, (len(motions), 3)) * self._sigmas * 0.5
        self._motions = iter(told.tolist())
        self._first = True

    def step(self, frame, features, prior=None):
        motion = Motion(SE2(*next(self._motions)), np.diag(self._sigmas**2))
        first, self._first = self._first, False
        return first_motion() if first else motion

    def rest(self, stamp_s):
        raise AssertionError(stamp_s)


def winding(count):
    """A robot's steps at 10 Hz: 0.4 m/s, and turns of 0.5 rad/s either way in between."""
    turns = np.where(np.arange(count) // 15 % 2 == 1, 0.05, 0.0) * np.where(np.arange(count) // 60 % 2, -1.0, 1.0)
    return np.column_stack([np.full(count, 0.04), np.zeros(count), turns])


def fused(true, told, seed=0):
    """Faults by stamp, and how far off the last pose is, (3,). told: by the wheels, None for none."""
    sources = {"camera": Noisy("window", "camera", true, seed)}
    if told is not None:
        sources["wheels"] = Noisy("wheel", "wheels", told, seed + 1)
    hybrid, faults, pose, there = HybridOdometry(sources), [], SE2(), SE2()
    for index, motion in enumerate(true):
        found = hybrid.step(Frame(index, index / 10.0, BLANK), {})
        if index:
            pose, there = pose @ found.motion, there @ SE2(*motion)
        faults += [(index / 10.0, fault.text) for fault in found.faults]
    return faults, (there.inverse() @ pose).vector()


@pytest.mark.parametrize("lie", [*LIES, "late"])
def test_lying_wheels_are_named_within_20_s_and_the_pose_stays_the_cameras(lie):
    true = winding(300)
    late = np.concatenate([np.zeros((5, 3)), true[:-5]])
    faults, off = fused(true, late if lie == "late" else true * LIES[lie])
    (stamp_s, fault), *others = faults
    assert fault.startswith("wheels: it is 0.50 s late" if lie == "late" else "wheels: its "), fault
    assert stamp_s < 20.0
    assert not others
    alone = fused(true, None)[1]
    assert math.hypot(off[0], off[1]) < math.hypot(alone[0], alone[1]) + 0.25  # of 12 m
    assert abs(off[2]) < abs(alone[2]) + 0.05


@pytest.mark.parametrize("lie", ["mirrored yaw", "frozen", "backwards"])
def test_wheels_that_recover_are_used_again(lie):
    true = winding(400)
    told = np.where((np.arange(400) // 100 == 1)[:, None], true * LIES[lie], true)
    faults, off = fused(true, told)
    assert [fault.partition(":")[0] for _, fault in faults] == ["wheels", "wheels"]
    assert faults[0][0] < 20.0 < faults[1][0] < 30.0
    assert faults[1][1] == "wheels: agrees with the camera again: used again"
    alone = fused(true, None)[1]
    assert math.hypot(off[0], off[1]) < math.hypot(alone[0], alone[1]) + 0.5  # of 16 m


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.floats(0.9, 1.1), st.floats(0.95, 1.05))
def test_honest_wheels_are_never_named(seed, length, yaw):
    true = winding(150)
    faults, _ = fused(true, true * [length, length, yaw], seed)
    assert not [fault for _, fault in faults if "left out" in fault]


def test_a_jump_of_the_heading_costs_one_step():
    stamps = np.arange(50) / 10.0
    jumped = [SE2(0.03 * row, 0.0, 0.0) if row < 20 else SE2(0.6, 0.0, 2.5) @ SE2(0.03 * (row - 20), 0.0, 0.0)
              for row in range(50)]  # fmt: skip
    odometry = RecordedOdometry(Trajectory(stamps, tuple(jumped)), "wheel:x", WHEEL)
    found = [odometry.step(Frame(row, stamp_s, BLANK), {}) for row, stamp_s in enumerate(stamps.tolist())]
    assert [row for row, motion in enumerate(found) if motion.blind] == [20]
    assert "jumps by 0.03 m and 2.50 rad in 0.100 s" in texts(found[20].faults)
    assert found[21].motion.x_m == pytest.approx(0.03)


FULL = math.radians(250.0)


def noisy(samples, gyro_rad_s=0.004, accel_m_s2=0.03):
    """The samples with a BMI055's noise."""
    random, size = np.random.default_rng(0), (len(samples), 3)
    gyro = samples.gyro_rad_s + random.normal(0.0, gyro_rad_s, size)
    return ImuSamples(samples.stamps_s, gyro, samples.accel_m_s2 + random.normal(0.0, accel_m_s2, size))


def imu(change=lambda gyro, accel, lies: None):
    """12 s of a BMI055 at rest on its mount; `change` writes the lie into the samples of 4 to 8 s."""
    stamps = np.arange(0.005, 12.0, 0.005)
    samples = noisy(level_samples(stamps))
    change(samples.gyro_rad_s, samples.accel_m_s2, (stamps > 4.0) & (stamps <= 8.0))
    source = AboutMount(MOUNT)
    ends, found, faults = np.arange(1, 120) / 10.0, [], []
    for row, end_s in enumerate(ends.tolist()):
        found.append(source.predict(Frame(row, end_s, BLANK, imu=samples.between(end_s - 0.1, end_s))))
        faults += [(end_s, fault) for fault in source.faults]
    return ends, found, faults


@pytest.mark.parametrize(("rate_hz", "faults"), [(4.0, 1), (4.5, 1), (5.5, 0), (20.0, 0)])
def test_an_imu_slower_than_half_the_frames_is_named_once_and_left_out(rate_hz, faults):
    samples = noisy(level_samples(np.arange(0.0, 30.0, 1.0 / rate_hz)), accel_m_s2=0.0)
    source, found, told = AboutMount(MOUNT), [], []
    for row, end_s in enumerate((np.arange(1, 300) / 10.0).tolist()):
        hole = 15.0 < end_s < 16.0
        part = samples.between(100.0, 101.0) if hole else samples.between(end_s - 0.1, end_s)
        found.append(source.predict(Frame(row, end_s, BLANK, imu=part)))
        told += [(row, fault) for fault in source.faults]
    assert len(told) == faults
    if faults:
        ((end, fault),) = told
        assert fault.kind is FaultKind.IMU_EXCLUDED
        assert re.match(r"IMU: one sample in 2\.[0-9] frames, .* needed", fault.text)
        assert end < 40
        assert {one.source for one in found[40:]} == {"mount"}


@pytest.mark.parametrize(
    ("named", "sensor", "axes", "told"),
    [
        ("gyro saturated at 4.4 rad/s", 0, np.s_[:], lambda true: FULL),
        ("accelerometer saturated at 19.6 m/s2", 1, 1, lambda true: -19.62),
        ("gyro frozen", 0, np.s_[:], lambda true: true[0]),
        ("gyro at", 0, 2, lambda true: np.random.default_rng(1).normal(100.0, 1.0, len(true))),
    ],
)
def test_an_imu_that_lies_is_named_at_once_left_out_and_used_again(named, sensor, axes, told):
    def lie(*samples):
        samples[sensor][samples[2], axes] = told(samples[sensor][samples[2]])

    ends, found, faults = imu(lie)
    (named_s, first), (again_s, second) = faults
    assert first.text.startswith(named)
    assert 4.0 < named_s <= 4.3
    assert (first.kind, second.kind) == (FaultKind.IMU_EXCLUDED, FaultKind.IMU_RESTORED)
    assert 8.0 < again_s < 10.0
    left_out = [one.source for end_s, one in zip(ends, found, strict=True) if named_s <= end_s <= 8.0]
    assert set(left_out) == {"mount"}
    turned = sum(one.rotation.yaw_rad for one in found if one.rotation is not None)
    assert abs(turned) < math.radians(1.0)


def test_a_good_imu_and_a_knock_of_20_ms_leave_nobody_out():
    def knocked(gyro, accel, lies):
        accel[np.flatnonzero(lies)[:4]] = 39.2

    for lie in (lambda *_: None, knocked):
        _, found, faults = imu(lie)
        assert not faults
        assert all(one.source == "imu" for one in found[1:])


def window_nees(motions, true, steps):
    """Mean squared Mahalanobis distance, per degree of freedom, of motions summed over so many steps."""
    found = []
    for first in range(0, len(motions) - steps, steps // 2):
        moved, covariance = SE2(), np.zeros((3, 3))
        for motion in motions[first + 1 : first + steps + 1]:
            covariance = compose_covariance(moved, covariance, motion.motion, motion.covariance)
            moved = moved @ motion.motion
        off = moved.vector() - (true[first].inverse() @ true[first + steps]).vector()
        off[2] = wrap_angle(off[2])
        found.append(off @ np.linalg.solve(covariance, off) / 3.0)
    return float(np.mean(found))


@pytest.mark.parametrize("wheels", [False, True])
def test_the_demos_motion_errs_by_what_it_states_and_not_by_much_less(demo, wheels):
    demo.camera.update_info(wheel=read_wheels(str(WHEELS)) if wheels else None)
    pipeline = build_slam(demo.camera, demo.bundle, demo.floor).pipeline
    frames = enumerate(zip(demo.images, demo.stamps_s, strict=True))
    motions = [pipeline.step(Frame(index, stamp_s, image)).motion for index, (image, stamp_s) in frames]
    true = [demo.camera.info.truth.at(stamp_s) for stamp_s in demo.stamps_s]
    for steps in (10, 50):
        # The demo is the easiest home: over 1 s by the camera alone 0.2, others 0.4 to 1.9, mean 0.9.
        assert 0.1 < window_nees(motions, true, steps) < 3.0


def test_what_a_mirrored_gyro_turns_is_not_what_the_odometry_turns():
    stamps = np.arange(0.005, 8.0, 0.005)
    samples = noisy(level_samples(stamps, np.where(stamps > 1.0, -0.5, 0.0)))
    source, faults = AboutMount(MOUNT), []
    for row, end_s in enumerate((np.arange(1, 79) / 10.0).tolist()):
        moved = SE2(0.0, 0.0, 0.05 if end_s > 1.15 else 0.0), np.diag([1e-6, 1e-6, 1e-5])
        frame = Frame(row, end_s, BLANK, imu=samples.between(end_s - 0.1, end_s))
        source.predict(frame, None if row < 2 else moved)
        faults += [(end_s, fault) for fault in source.faults]
    ((named_s, fault),) = faults
    assert fault.text.startswith("gyro: its yaw is -")
    assert named_s < 4.0


def test_a_gyro_that_lies_is_found_after_a_long_rest_too():
    """3,000 s without a turn, then turns of a quarter radian to and fro, of which the gyro shows twice as much."""
    trust, up, still, faults = ImuTrust(0.5, TrustRule()), np.array([0.0, -1.0, 0.0]), (SE2(), np.eye(3) * 1e-10), []
    moved = still
    for step in range(3020):
        turned = 0.0 if step < 3000 else 0.25 * (1 if step % 4 < 2 else -1)
        rates = np.random.default_rng(step).normal(0.0, 0.001, (40, 3)) + 2.0 * turned * up
        samples = ImuSamples(step + np.arange(1, 41) / 40.0, rates, np.tile(9.81 * up, (40, 1)))
        faults.append(trust.judge(samples, float(step + 1), moved, up, np.zeros(3))[1])
        moved = (SE2(0.0, 0.0, turned), np.eye(3) * 1e-6) if turned else still
    (fault,) = filter(None, faults)
    assert re.match(r"gyro: its yaw is \d+ % of what the camera measures: the IMU is left out", fault.text)
    assert faults.index(fault) < 3006
