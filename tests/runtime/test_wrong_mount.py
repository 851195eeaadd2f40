"""A mount whose pitch is given wrong, through the real Pipeline on the demo: found, told once, and used."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import mount_text
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.inertial import AttitudeRule
from edgemap.runtime.motion.attitude.mount_check import MountRule
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.slam import SlamOptions, build_slam

TRUE_DEG, OFF_DEG, FRAMES = 11.5, 2.0, 130
BLIND_TO_EDGES = MountRule(first_every_s=math.inf)


def drive(demo, off_deg, rule=None, **options):
    """Faults that name the mount, what was observed last, the mount and the map's objects, of the demo with its pitch
    given wrong by so much."""
    config = Config(attitude=AttitudeRule(check=rule or MountRule()))
    mount = replace(demo.camera.info.mount, pitch_rad=demo.camera.info.mount.pitch_rad + math.radians(off_deg))
    floor = FloorCamera(demo.camera.info.intrinsics, mount)
    slam = build_slam(demo.camera, demo.bundle, floor, SlamOptions(**options), config)
    faults, result = [], None
    for index in range(FRAMES):
        result = slam.step(Frame(index, demo.stamps_s[index], demo.images[index]))
        faults += [fault.text for fault in result.observed.faults if fault.kind is FaultKind.MOUNT_ANGLES]
    assert result
    return faults, result.observed, mount, slam.objects()


@pytest.fixture(scope="module")
def right(whole_demo):
    return drive(whole_demo, 0.0, wheels=False)


@pytest.fixture(scope="module")
def wrong(whole_demo):
    return drive(whole_demo, OFF_DEG, wheels=False)


def test_two_degrees_are_told_once_and_every_frame_is_levelled_by_what_was_seen(wrong):
    faults, observed, mount, _ = wrong
    (fault,) = faults
    found = re.match(
        rf"mount: pitch {TRUE_DEG + OFF_DEG:.1f} and roll 0.0 deg given, .* give pitch ([\d.]+) and", fault
    )
    assert found, fault
    assert float(found[1]) == pytest.approx(TRUE_DEG, abs=0.8)
    assert math.degrees(observed.camera.attitude.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.6)
    seen = observed.mount_estimate
    assert abs(math.degrees(seen.mount.pitch_rad) - TRUE_DEG) < 2.5 * math.degrees(seen.sigma_rad[1])
    assert re.fullmatch(
        rf"mount: pitch {TRUE_DEG + OFF_DEG:.1f} deg given, 1[12]\.\d \+- 0\.\d deg estimated; roll .*",
        mount_text(mount, seen),
    )


def test_motion_and_turns_alone_tell_it_where_a_room_shows_no_edges(demo):
    faults, observed, _, _ = drive(demo, 2.0, BLIND_TO_EDGES, wheels=False)
    assert len(faults) == 1
    assert "the direction of motion" in faults[0]
    assert math.degrees(observed.camera.attitude.pitch_rad) == pytest.approx(TRUE_DEG, abs=0.8)


def test_the_right_mount_holds_to_the_last_digit(right):
    faults, observed, mount, _ = right
    assert not faults
    assert observed.mount_estimate.used == mount
    assert np.degrees(observed.mount_estimate.sigma_rad).max() < 0.6


def test_nothing_stays_on_the_map_where_the_wrong_mount_has_put_it(right, wrong):
    """Ghosts of a backpack and a suitcase, 0.6 m before the true ones, at confidence 0.9."""
    objects = wrong[3]
    assert len(objects) >= 3
    for item in objects:
        same = [other.position_m for other in right[3] if other.label == item.label]
        assert min(np.linalg.norm(np.subtract(place, item.position_m)) for place in same) < 0.3, item.id
