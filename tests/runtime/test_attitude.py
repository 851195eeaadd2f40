"""Where attitudes come from: recorded poses, inertial samples, the mount, pictures alone."""

import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.edges import room_edges
from support.inertial import MOUNT, AboutMount, level_samples

import edgemap
from edgemap.evaluation.trajectory import attitude_figures
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import InertialFilter, InertialNoise, small_rotation
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, up_optical
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.motion.attitude.estimator import EstimatedAttitude
from edgemap.runtime.motion.attitude.inertial import AttitudeRule
from edgemap.runtime.motion.attitude.mount_check import MountRule
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.simulation.carried_imu import carried_imu

BLANK = np.zeros((4, 4, 3), np.uint8)
LENS = Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)


def samples_of(pitch_rad, stamps, roll_deg=0.0, bias=(0.0, 0.0, 0.0), offset_rad=0.0):
    """A camera that only nods, as its IMU has it; pitch_rad: at each stamp. A pitch is a rate about x (right)."""
    rates = np.zeros((len(stamps), 3))
    rates[:, 0] = -np.gradient(pitch_rad, stamps)
    mounts = (Mount(1.0, pitch + offset_rad, math.radians(roll_deg)) for pitch in pitch_rad)
    ups = [mount.rotation_base_optical().T @ [0, 0, 9.81] for mount in mounts]
    return ImuSamples(stamps, rates + bias, np.array(ups))


def frames_of(samples, rate_hz):
    ends = np.arange(samples.stamps_s[0] + 1.0 / rate_hz, samples.stamps_s[-1], 1.0 / rate_hz)
    for index, end_s in enumerate(ends):
        yield Frame(index, float(end_s), BLANK, imu=samples.between(end_s - 1.0 / rate_hz, end_s))


def test_a_nodding_robot_is_followed_and_its_gyro_bias_is_learnt_at_rest():
    stamps = np.arange(0.0, 30.0, 0.005)
    nod = np.where(stamps > 4.0, math.radians(3.0) * np.sin(2.0 * math.pi * 0.7 * (stamps - 4.0)), 0.0)
    samples = samples_of(MOUNT.pitch_rad + nod, stamps, bias=(0.02, -0.03, 0.04))
    source = AboutMount(MOUNT)
    errors, yaw = [], 0.0
    for frame in frames_of(samples, 10.0):
        attitude = source.predict(frame)
        errors.append(attitude.pitch_rad - MOUNT.pitch_rad - np.interp(frame.stamp_s, stamps, nod))
        if frame.stamp_s > 4.0 and attitude.rotation is not None:
            yaw += attitude.rotation.yaw_rad
    assert math.degrees(np.sqrt(np.mean(np.square(errors[50:])))) < 0.3
    assert abs(math.degrees(yaw)) < 1.0  # 26 s of a bias of 2.4 deg/s would be 60


def test_a_constant_tilt_between_imu_and_mount_is_learnt():
    stamps = np.arange(0.0, 60.0, 0.01)
    samples = samples_of(np.full(len(stamps), MOUNT.pitch_rad), stamps, offset_rad=math.radians(3.0))
    source = AboutMount(MOUNT)
    *_, last = (source.predict(frame) for frame in frames_of(samples, 10.0))
    assert math.degrees(last.pitch_rad) == pytest.approx(10.0, abs=0.2)
    assert math.degrees(last.force_rad[1] - last.pitch_rad) == pytest.approx(3.0, abs=0.2)


def test_without_samples_the_other_source_speaks_and_a_hole_starts_the_filter_again():
    source = AboutMount(MOUNT, sigma_rad=math.radians(0.7))
    bare = source.predict(Frame(0, 0.0, BLANK))
    assert bare.source == "mount"
    assert bare.covariance_rad2[0, 0] == pytest.approx(math.radians(0.7) ** 2)
    told = []
    for frame in frames_of(level_samples(np.arange(1.0, 8.0, 0.01)), 10.0):
        hole = Frame(frame.index, frame.stamp_s, BLANK) if 3.0 < frame.stamp_s < 5.0 else frame
        told.append((source.predict(hole).source, round(frame.stamp_s, 2)))
    assert {name for name, stamp_s in told if 3.05 < stamp_s < 4.95} == {"mount"}
    assert told[-1][0] == "imu"


def test_a_real_lounge_has_attitudes_heights_and_objects(shared_data):
    drive = open_drive(f"c2w:{shared_data / 'lounge'}")
    assert len(drive.objects) > 15
    track = drive.attitudes
    assert math.degrees(track.pitch_rad[0]) == pytest.approx(35.4, abs=0.1)  # asin(0.5795), line 1 of poses.txt
    assert track.risen_m.max() == pytest.approx(0.1085, abs=1e-3)


def test_a_real_flight_is_levelled_within_a_degree_and_keeps_its_heading_to_a_degree_a_minute(shared_data):
    """EuRoC V1_01: 145 s. Truth and IMU frame differ by a constant rotation, which is taken out. Heading: what follows
    the first 3 s, in which the bias is learnt."""
    drive = open_drive(f"euroc:{shared_data / 'euroc'}")
    noise, given_rad, state, last_s = InertialNoise(), MountTiltRule().prior, None, -math.inf
    found, true, turned_rad, rate_hz = [], [], [], 20.0
    for end_s in np.arange(0.05, drive.imu.stamps_s[-1], 1.0 / rate_hz):
        part, last_s = drive.imu.between(last_s, end_s), end_s
        if state is None:
            state = InertialFilter(part, end_s, noise, given_rad)
        else:
            state.step(part, end_s)
        if drive.attitudes.stamps_s[0] < end_s < drive.attitudes.stamps_s[-1]:
            truth = drive.attitudes.at(end_s, 1.0)
            true.append(Mount(1.0, truth.pitch_rad, truth.roll_rad).rotation_base_optical()[2])
            found.append(state.up_optical)
            if end_s > 3.0:
                turned_rad.append(math.atan2(*state.heading[::-1]) - drive.truth.at(end_s).yaw_rad)
    found, true = np.array(found), np.array(true)
    u, _, v = np.linalg.svd(found.T @ true)
    turned = true @ (u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v).T
    errors = np.arccos(np.clip((found * turned).sum(axis=1), -1.0, 1.0))
    assert math.degrees(np.sqrt((errors**2).mean())) < 0.9
    slope = np.polyfit(np.arange(len(turned_rad)) / rate_hz, np.unwrap(turned_rad), 1)[0]
    assert abs(math.degrees(slope)) * 60.0 < 1.0


def test_a_mount_that_is_5_degrees_wrong_by_gravity_alone_is_a_fault_within_20_seconds():
    samples = level_samples(np.arange(0.0, 20.0, 0.01), mount=Mount.from_degrees(0.6, 11.5))
    told = {}
    for pitch_deg in (17.0, 11.5):
        mount = Mount.from_degrees(0.6, pitch_deg)
        source = EstimatedAttitude(FloorCamera(LENS, mount))
        attitudes, told[pitch_deg] = [], []
        for frame in frames_of(samples, 10.0):
            attitudes.append(source.predict(frame))
            told[pitch_deg] += source.faults
        assert math.degrees(attitudes[-1].pitch_rad) == pytest.approx(11.5, abs=0.5)
    assert not told[11.5]
    (fault,) = told[17.0]
    found = re.match(r"mount: pitch 17.0 and roll 0.0 deg given, gravity give pitch ([\d.]+) and roll", fault.text)
    assert found, fault
    assert float(found[1]) == pytest.approx(11.5, abs=0.5)


def test_a_roll_of_a_camera_that_looks_down_is_no_yaw_of_the_base():
    stamps = np.arange(0.0, 6.0, 0.005)
    rolls = math.radians(8.0) * np.sin(2.0 * math.pi * 0.5 * stamps)
    rates = np.zeros((len(stamps), 3))
    rates[:, 2] = np.gradient(rolls, stamps)  # about the optical axis
    ups = [Mount(1.0, math.radians(30.0), roll).rotation_base_optical().T @ [0, 0, 9.81] for roll in rolls]
    mount = Mount.from_degrees(1.0, 30.0)
    source = AboutMount(mount)
    attitudes = [source.predict(frame) for frame in frames_of(ImuSamples(stamps, rates, np.array(ups)), 10.0)]
    yaws = [attitude.rotation.yaw_rad for attitude in attitudes if attitude.rotation is not None]
    assert math.degrees(max(map(abs, yaws[20:]))) < 0.1  # the rate about the vertical is sin 30 deg of 2.5 deg a frame


def driving(source, samples, motion_of, rate_hz=10.0):
    """Attitudes of a drive whose odometry tells each frame the motion before, and their stamps."""
    found, ends = [], []
    for frame in frames_of(samples, rate_hz):
        known = (motion_of(ends[-2], ends[-1]), np.diag([0.001**2] * 3)) if len(ends) > 1 else None
        found.append(source.predict(frame, known))
        ends.append(frame.stamp_s)
    return found, np.array(ends)


def forces(ahead_m_s2):
    """By base axes, of a robot that speeds up by so much at each sample."""
    return np.column_stack([ahead_m_s2, np.zeros(len(ahead_m_s2)), np.full(len(ahead_m_s2), 9.81)])


def test_a_slow_steady_turn_is_no_rest_that_teaches_the_bias():
    """3 deg/s of turn and 1 deg/s of bias: calm samples, which alone would be taken for 4 deg/s of bias at rest."""
    samples, source = level_samples(np.arange(0.0, 20.0, 0.005), math.radians(4.0)), AboutMount(MOUNT)
    found, ends = driving(source, samples, lambda a, b: SE2(0.1 * (b - a), 0.0, math.radians(3.0) * (b - a)))
    late = [attitude.rotation.yaw_rad for attitude, end_s in zip(found, ends, strict=True) if end_s > 10.0]
    assert math.degrees(sum(late)) / (len(late) / 10.0) == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(("given_deg", "begins_deg"), [(10.0, 25.0), (20.0, 10.0)])
def test_first_samples_are_held_against_the_mount_as_far_as_it_may_be_wrong(given_deg, begins_deg):
    """Gravity says 25 degrees, the mount 10: a mount that may be 20 degrees wrong is taken, one of 10 is not."""
    samples = level_samples(np.arange(0.0, 0.5, 0.005), mount=Mount.from_degrees(0.5, 25.0))
    rule = AttitudeRule(check=MountRule(tilt=MountTiltRule(prior=math.radians(given_deg))))
    source = AboutMount(MOUNT, rule)
    found = source.predict(next(iter(frames_of(samples, 10.0))))
    assert math.degrees(found.pitch_rad) == pytest.approx(begins_deg, abs=2.0)


def test_the_accelerometer_tells_the_displacement_of_a_step_that_odometry_has_not_measured_yet():
    """A robot at 0.5 m/s brakes by 1 m/s^2: 4.5 cm in the first step, 0.5 cm in the fifth; by pictures up to there."""
    mount, stamps = Mount(0.5, math.radians(10.0), 0.0, 0.2, 0.1), np.arange(0.0, 10.6, 0.005)
    samples = level_samples(stamps, 0.0, forces(np.where(stamps > 10.0, -1.0, 0.0)), mount)

    def path_m(stamp_s):
        late_s = min(max(stamp_s - 10.0, 0.0), 0.5)
        return 0.5 * stamp_s - late_s**2 / 2.0

    source = AboutMount(mount)
    found, ends = driving(source, samples, lambda a, b: SE2(path_m(b) - path_m(a), 0.0, 0.0))
    steps = [attitude.rotation.displaced for attitude, end_s in zip(found, ends, strict=True) if end_s > 10.05][:5]
    assert [float(moved[0]) for moved, _ in steps] == pytest.approx([0.045, 0.035, 0.025, 0.015, 0.005], abs=0.003)
    assert all(abs(float(moved[1])) < 0.001 for moved, _ in steps)
    assert all(0.002 < math.sqrt(covariance[0, 0]) < 0.02 for _, covariance in steps)


def test_the_robots_own_acceleration_is_no_tilt():
    """It speeds up and brakes by 0.5 m/s^2 (3 degrees of false tilt) on a loose mount, with a calibrated IMU."""
    stamps = np.arange(0.0, 20.0, 0.005)
    accel = 0.5 * np.sign(np.sin(2.0 * math.pi * stamps / 8.0))
    speed = np.cumsum(accel) * 0.005
    place = np.cumsum(speed) * 0.005
    samples = level_samples(stamps, 0.0, forces(accel))
    loose = MountRule(tilt=MountTiltRule(nod=math.radians(20.0)))
    rule = AttitudeRule(check=loose, noise=InertialNoise(offset=1e-4))
    source, deaf = (AboutMount(MOUNT, rule) for _ in range(2))
    found, _ = driving(source, samples, lambda a, b: SE2(float(np.diff(np.interp([a, b], stamps, place))[0]), 0.0, 0.0))
    alone = [deaf.predict(frame) for frame in frames_of(samples, 10.0)]
    errors, before = (np.degrees([a.pitch_rad - MOUNT.pitch_rad for a in told[50:]]) for told in (found, alone))
    assert np.abs(errors).max() < 0.5
    assert np.abs(before).max() > 2.0 * np.abs(errors).max()


def carried_head(seed, seconds=10.0):
    """Samples of a head that walks off at 1 m/s, nods by 10 degrees about 5 below the mount and turns, with a
    datasheet's errors and no rest; and its true poses, (N, 4, 4) of the base."""
    stamps = np.arange(0.0, seconds, 0.1)
    mount, random = Mount.from_degrees(1.7, 20.0), np.random.default_rng(seed)
    phase = random.uniform(0.0, math.tau, 4)
    yaw = 0.8 * np.sin(0.8 * stamps + phase[0])
    nod = math.radians(5.0) + math.radians(10.0) * np.sin(2.0 * stamps + phase[1])
    lean = math.radians(3.0) * np.sin(2.5 * stamps + phase[2])
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", np.column_stack([yaw, nod, lean])).as_matrix()
    speed = 1.0 + 0.15 * np.sin(6.0 * stamps + phase[3])
    poses[:, :2, 3] = np.cumsum(0.1 * speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)
    drive = Drive("c2w", Path(), (), stamps, mount=mount, full_poses=poses)
    return mount, poses, stamps, carried_imu(drive, random)


def test_a_head_in_motion_from_the_start_is_levelled_and_its_covariance_says_how_well():
    scaled, late = [], []
    for seed in range(8):
        mount, poses, stamps, samples = carried_head(seed)
        source, random = AboutMount(mount), np.random.default_rng(seed)
        headings = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
        bases = [SE2(x, y, yaw) for (x, y), yaw in zip(poses[:, :2, 3], headings, strict=True)]
        for index in range(1, len(stamps) - 1):
            frame = Frame(index, float(stamps[index]), BLANK, imu=samples.between(stamps[index - 1], stamps[index]))
            moved = None
            if index > 2:
                errors = random.normal(0.0, [0.03, 0.03, 0.003])
                motion = bases[index - 2].inverse() @ bases[index - 1] @ SE2(*errors)
                moved = motion, np.diag(np.square([0.03, 0.03, 0.003]))
            found = source.predict(frame, moved)
            up = (poses[index, :3, :3] @ mount.rotation_base_optical())[2]
            true = Attitude.of_up(up, np.zeros((2, 2)), "true")
            error = np.array([found.roll_rad - true.roll_rad, found.pitch_rad - true.pitch_rad])
            scaled.append(error @ np.linalg.solve(found.covariance_rad2, error))
            if stamps[index] > 3.0:
                late.append(error)
    assert 1.3 < np.mean(scaled) < 3.0  # two angles: 2 where errors and covariance agree, 2.06 here
    assert math.degrees(np.sqrt(np.mean(np.square(late)))) < 2.0


def turning(rate_rad_s, lost):
    """A level robot that turns about the vertical at a rate (N,), 100 samples a second; lost: from where to where."""
    stamps = np.arange(1, len(rate_rad_s) + 1) / 100.0
    kept = (stamps <= lost[0]) | (stamps > lost[1])
    return level_samples(stamps[kept], rate_rad_s[kept])


@pytest.mark.parametrize("hole_s", [0.2, 0.5, 0.8])
def test_a_turn_that_no_sample_shows_is_within_what_the_gyro_states(hole_s):
    """From rest and back to rest within a hole between two frames, at 3 rad/s2: the rates beside it show nothing."""
    stamps = np.arange(1, 201) / 100.0
    rate, turned_rad = 3.0 * np.maximum(hole_s / 2.0 - np.abs(stamps - 1.5), 0.0), 3.0 * (hole_s / 2.0) ** 2
    samples = turning(rate, (1.5 - hole_s / 2.0, 1.5 + hole_s / 2.0))
    source = AboutMount(MOUNT)
    found = [source.predict(Frame(k, float(k), BLANK, imu=samples.between(k - 1.0, k))).rotation for k in (0, 1, 2)]
    whole, rotation = found[1:]
    assert whole.sigma_rad < 0.02
    missed_rad = abs(turned_rad - rotation.yaw_rad)
    assert 0.9 * turned_rad < missed_rad < 3.0 * rotation.sigma_rad < 1.0


def test_a_hole_across_a_frame_is_stated_in_both_steps():
    """Rates that walk as the filter assumes: errors of both rotations are as large as stated, in the mean of 60."""
    ratios, stamps = [], [0.0, 1.0, 1.5, 2.0]
    for seed in range(60):
        rate = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.1, 200))
        samples, source = turning(rate, (1.25, 1.75)), AboutMount(MOUNT)
        spans = enumerate(pairwise([-1.0, *stamps]))
        frames = [Frame(k, until_s, BLANK, imu=samples.between(from_s, until_s)) for k, (from_s, until_s) in spans]
        found = [source.predict(frame).rotation for frame in frames]
        true = [rate[int(100 * a) : int(100 * b)].sum() / 100.0 for a, b in pairwise(stamps[1:])]
        seen = [rotation for rotation in found[2:] if rotation is not None]
        ratios.append([(one.yaw_rad - turned) / one.sigma_rad for one, turned in zip(seen, true, strict=True)])
    assert np.sqrt(np.mean(np.square(ratios), axis=0)) == pytest.approx([1.0, 1.0], abs=0.35)


@pytest.mark.parametrize("rate_rad_s", [0.5, 1.4])  # faster ones that repeat are full scale
def test_the_rotation_is_known_from_the_first_frame_on_whose_samples_reach_back_to_the_one_before(rate_rad_s):
    samples, source = level_samples(np.arange(0.01, 1.0, 0.01), rate_rad_s), AboutMount(MOUNT)
    up = MOUNT.rotation_base_optical().T @ [0.0, 0.0, 1.0]
    assert source.predict(Frame(0, 0.0, BLANK)).rotation is None
    rotation = source.predict(Frame(1, 0.1, BLANK, imu=samples.between(0.0, 0.1))).rotation
    assert rotation.yaw_rad == pytest.approx(0.1 * rate_rad_s, rel=0.04)
    np.testing.assert_allclose(rotation.rotation, Rotation.from_rotvec(0.1 * rate_rad_s * up).as_matrix(), atol=5e-5)


HEAD, TILT = Mount.from_degrees(1.7, 20.0), MountTiltRule()


def test_edges_of_the_room_show_up_in_the_last_frame_while_the_camera_turns():
    source, rng, turn = PicturesAttitude(HEAD, TILT), np.random.default_rng(1), small_rotation(0.03, 0.02, 0.1)
    up, rotation = up_optical(HEAD.pitch_rad, 0.0), TrackedRotation(turn, Carried().certain())
    for index in range(2):
        source.predict(index / 10.0)
        source.update(rotation)
        up = turn.T @ up
        true = Attitude.of_up(up, np.zeros((2, 2)), "truth")
        pitch_deg, roll_deg = np.degrees([true.pitch_rad, true.roll_rad]).tolist()
        room = source.see_edges(*room_edges(pitch_deg, roll_deg, rng))
        assert np.linalg.norm(np.cross(room.up, up)) < math.radians(1.0)


def test_edges_of_two_pictures_show_the_room_together_turned_with_the_camera():
    source, rng, turn = PicturesAttitude(HEAD, TILT), np.random.default_rng(0), small_rotation(0.0, 0.02, 0.5)
    normals, lengths = room_edges(20.0, 0.0, rng, count=6, outliers=0)
    first, second = np.arange(0, len(lengths), 2), np.arange(1, len(lengths), 2)
    assert source.see_edges(normals[first], lengths[first]) is None
    source.update(TrackedRotation(turn, Carried().certain()))
    room = source.see_edges(normals[second] @ turn, lengths[second])
    assert np.linalg.norm(np.cross(room.up, turn.T @ up_optical(HEAD.pitch_rad, 0.0))) < math.radians(1.0)


def test_a_carried_camera_has_the_tilt_of_the_odometry_and_a_mounted_one_begins_each_frame_at_its_mount():
    source, up = PicturesAttitude(HEAD, TILT), up_optical(math.radians(30.0), math.radians(5.0))
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


def test_a_real_walk_is_seen_level_without_an_imu(shared_data):
    drive = open_drive(f"c2w:{shared_data / 'hololens'}")
    camera = drive_camera(replace(drive, depth=()), "a walk")
    with edgemap.open(camera, "edgemap-pico") as session:
        found = [step.observed.camera.attitude for step, _ in zip(session, range(80), strict=False)]
    true = [drive.attitudes.at(stamp_s, HEAD.height_m) for stamp_s in drive.stamps_s[:80]]
    mount = attitude_figures([Attitude.of_mount(drive.mount)] * 45, true[35:])
    told = [(own, level) for own, level in zip(found[35:], true[35:], strict=True) if own.source == "pictures"]
    assert len(told) > 40  # of 45; the others are the mount's
    figures = attitude_figures(*zip(*told, strict=True))
    assert figures["pitch_rms_deg"] < 0.3 * mount["pitch_rms_deg"]
    assert 0.15 < figures["nees"] < 6.0  # 0.33
