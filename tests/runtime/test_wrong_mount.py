"""Mounts that are given wrong: found by edges, motion and depth, told once, and used."""

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.edges import room_edges

from edgemap.cli.summary import mount_text
from edgemap.geometry.camera.attitude import TrackedRotation
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import HeightEstimate, Mount, Platform, pitch_roll, up_optical
from edgemap.geometry.camera.room_edges import room_axes
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.attitude.estimator import EstimatedAttitude
from edgemap.runtime.motion.attitude.inertial import AttitudeRule
from edgemap.runtime.motion.attitude.mount_check import MountRule
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.slam import SlamOptions, build_slam

TRUE_DEG, GIVEN_DEG, FRAMES = 11.5, 13.5, 130
BLIND_TO_EDGES = MountRule(first_every_s=math.inf)


def drive(demo, off_deg, rule=None, **options):
    """Faults that name the mount, what was observed last, the mount and the map's objects, of the demo with its pitch
    given wrong by so much."""
    config = Config(attitude=AttitudeRule(check=rule or MountRule()))
    mount = replace(demo.camera.info.mount, pitch_rad=demo.camera.info.mount.pitch_rad + math.radians(off_deg))
    floor = FloorCamera(demo.camera.info.intrinsics, mount)
    slam = build_slam(demo.camera, demo.bundle, floor, SlamOptions(**options), config)
    faults = []
    for index in range(FRAMES):
        result = slam.step(Frame(index, demo.stamps_s[index], demo.images[index]))
        faults += [fault.text for fault in result.observed.faults if fault.kind is FaultKind.MOUNT_ANGLES]
    return faults, result.observed, mount, slam.objects()


@pytest.fixture(scope="module")
def right(whole_demo):
    return drive(whole_demo, 0.0, wheels=False)


@pytest.fixture(scope="module")
def wrong(whole_demo):
    return drive(whole_demo, GIVEN_DEG - TRUE_DEG, wheels=False)


def test_two_degrees_are_told_once_and_every_frame_is_levelled_by_what_was_seen(wrong):
    faults, observed, mount, _ = wrong
    (fault,) = faults
    found = re.match(rf"mount: pitch {GIVEN_DEG:.1f} and roll 0.0 deg given, .* give pitch ([\d.]+) and", fault)
    assert found, fault
    assert float(found[1]) == pytest.approx(TRUE_DEG, abs=0.8)
    assert math.degrees(observed.camera.attitude.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.6)
    seen = observed.mount_estimate
    assert abs(math.degrees(seen.mount.pitch_rad) - TRUE_DEG) < 2.5 * math.degrees(seen.sigma_rad[1])
    told = rf"mount: pitch {GIVEN_DEG:.1f} deg given, 1[12]\.\d \+- 0\.\d deg estimated; roll .*"
    assert re.fullmatch(told, mount_text(mount, seen))


@pytest.mark.parametrize(("source", "sigma_m", "shown"), [("given", 0.05, 1), ("given", 0.1, 0), ("guessed", 0.1, 1)])
def test_an_estimate_that_cannot_show_a_wrong_height_is_no_line(source, sigma_m, shown):
    line = mount_text(Mount(0.69, 0.3), None, HeightEstimate(0.28, sigma_m), (source, source))
    assert bool(line) == shown


def test_turns_alone_tell_three_degrees_where_a_room_shows_no_edges(demo):
    faults, observed, _, _ = drive(demo, 3.0, BLIND_TO_EDGES, wheels=False)
    assert len(faults) == 1
    assert "turns" in faults[0]
    assert math.degrees(observed.camera.attitude.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.8)


def off_deg(used, mount):
    """Between the angles of two mounts."""
    return math.degrees(math.hypot(used.pitch_rad - mount.pitch_rad, used.roll_rad - mount.roll_rad))


def test_the_right_mount_is_no_fault_and_stays_right(right):
    faults, observed, mount, _ = right
    assert not faults
    assert off_deg(observed.mount_estimate.used, mount) < 0.4
    assert np.degrees(observed.mount_estimate.sigma_rad).max() < 0.6


def test_one_degree_is_too_little_for_a_fault_and_is_corrected_once_the_estimate_has_converged(demo):
    faults, observed, _, _ = drive(demo, 1.0, wheels=False)
    assert not faults
    assert math.degrees(observed.mount_estimate.used.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.4)
    assert math.degrees(observed.camera.attitude.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.5)


def test_nothing_stays_on_the_map_where_the_wrong_mount_has_put_it(right, wrong):
    """Ghosts of a backpack and a suitcase, 0.6 m before the true ones, at confidence 0.9."""
    objects = wrong[3]
    assert len(objects) >= 3
    for item in objects:
        same = [other.position_m for other in right[3] if other.label == item.label]
        assert min(np.linalg.norm(np.subtract(place, item.position_m)) for place in same) < 0.3, item.id


@pytest.mark.parametrize(("pitch", "roll"), [(11.5, 0.0), (3.0, -2.0), (17.5, 4.0), (21.0, -1.0)])
def test_up_of_a_room_seven_degrees_from_where_it_is_expected(pitch, roll):
    normals, lengths = room_edges(pitch, roll, np.random.default_rng(3))
    expected = up_optical(math.radians(pitch - 5.0), math.radians(roll + 5.0))
    found = room_axes(normals, lengths, expected, math.radians(12))
    assert np.degrees(pitch_roll(found.up)) == pytest.approx((pitch, roll), abs=0.5)


def test_the_room_lies_as_its_level_edges_do():
    normals, lengths = room_edges(11.5, 0.0, np.random.default_rng(3))
    found = room_axes(normals, lengths, up_optical(math.radians(9.0), 0.0), math.radians(12))
    off = (found.level_rad - math.radians(25.0) + math.pi / 4) % (math.pi / 2) - math.pi / 4  # as of `room_edges`
    assert abs(off) < math.radians(0.7)
    assert math.radians(0.4) < found.sigma_rad < math.radians(3.1)
    few = np.arange(24) < 14  # upright edges, and two level ones
    assert room_axes(normals[:24][few], lengths[:24][few], found.up, math.radians(6)).level_rad is None


def told(off_deg, frames=80, still=False, hz=10.0):
    """Faults with the stamps of their frames, and the last attitude, for the demo under a mount so far off."""
    faults, attitude = [], None
    with open_camera("demo") as camera:
        mount = replace(camera.info.mount, pitch_rad=camera.info.mount.pitch_rad + math.radians(off_deg))
        source = EstimatedAttitude(FloorCamera(camera.info.intrinsics, mount))
        first = camera.read()
        for index in range(frames):
            frame = first if still else camera.read()
            attitude = source.predict(replace(frame, index=index, stamp_s=index / hz))
            faults += [(index / hz, fault) for fault in source.faults]
    return faults, attitude


def test_the_right_mount_holds_and_one_picture_of_a_robot_at_rest_is_one_view():
    faults, attitude = told(0.0)
    assert (faults, attitude.pitch_rad, attitude.source) == ([], math.radians(11.5), "mount")
    assert told(5.5, still=True)[0] == []


@pytest.mark.parametrize(("off_deg", "hz"), [(5.5, 10.0), (-5.5, 10.0), (5.5, 2.5), (5.5, 30.0)])
def test_a_pitch_5_degrees_wrong_is_one_fault_that_names_the_likelier_and_is_mended_at_any_rate(off_deg, hz):
    ((stamp_s, fault),), attitude = told(off_deg, frames=int(15 * hz), hz=hz)
    assert stamp_s < 20.0
    assert f"mount: pitch {11.5 + off_deg:.1f} and roll 0.0 deg given, the room's edges give pitch 11." in fault.text
    assert math.degrees(attitude.pitch_rad) == pytest.approx(11.5, abs=0.6)


def tilted(frame, lens, down_rad):
    """The frame of a camera that looks farther down."""
    matrix = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    turn = matrix @ cv2.Rodrigues(np.array([down_rad, 0.0, 0.0]))[0] @ np.linalg.inv(matrix)
    size = (lens.width, lens.height)
    return replace(frame, image=cv2.warpPerspective(frame.image, turn, size, borderMode=cv2.BORDER_REPLICATE))


def test_a_known_mount_stays_known_while_the_robot_sways():
    """Two seconds that look 5 degrees further down, as over a threshold, after ten that told the mount."""
    calm = Carried(steady_m=3.0)
    swaying = replace(calm, rate2=math.radians(10.0) ** 2)
    with open_camera("demo") as camera:
        lens = camera.info.intrinsics
        source = EstimatedAttitude(FloorCamera(lens, camera.info.mount))
        for index in range(130):
            frame, sways = camera.read(), 100 <= index < 120
            source.predict(tilted(frame, lens, math.radians(5.0)) if sways else frame)
            assert not source.faults
            attitude = source.update(TrackedRotation(np.eye(3), swaying if sways else calm))
    assert np.degrees(attitude.mount.sigma_rad).max() < 0.5
    assert off_deg(attitude.mount.used, camera.info.mount) < 0.4


@pytest.mark.parametrize(("given", "platform"), [((0.6, 11.5), "robot"), ((1.25, 0.0), "robot"), ((2.4, 11.5), "car")])
def test_edges_that_scatter_show_a_carried_camera_in_rooms_and_nothing_on_a_road(given, platform):
    """A level lens on a pole is in a room; a car's mount stays as given whatever the edges show."""
    with open_camera("demo") as camera:
        lens = camera.info.intrinsics
        mount = Mount.from_degrees(*given, platform=Platform(platform))
        source = EstimatedAttitude(FloorCamera(lens, mount))
        for index in range(80):
            attitude = source.predict(tilted(camera.read(), lens, math.radians(4.0 * math.sin(index / 6.0))))
            source.update(TrackedRotation(np.eye(3)))
    assert attitude.carried is (platform == "robot")
    assert attitude.mount is None or attitude.mount.used == mount
