import math
from dataclasses import replace

import numpy as np
import pytest
from support.faults import made, texts
from support.odometry import MadeOdometry

from edgemap.geometry.camera.attitude import Attitude, GyroRotation, RoomAxes
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.gyro import GyroOdometry
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry, HybridRule
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion, MotionState, blind_motion
from edgemap.runtime.motion.trust import TrustRule

FRAME = Frame(0, 0.0, np.zeros((4, 4, 3), np.uint8))
LASTING = HybridRule().covariance_scale
BELIEVED = HybridRule(trust=TrustRule(windows=0))


def fusing(**sources):
    """A hybrid that trusts its wheels: whether it may is tests/runtime/test_trust.py's."""
    return HybridOdometry(sources, BELIEVED)


def of(**motions):
    """A hybrid of scripted sources: of(camera=[...], wheels=[...])."""
    return fusing(**{source: Scripted(*scripted) for source, scripted in motions.items()})


def steps_of(hybrid, count, hz=10.0):
    """So many steps of frames at a steady rate."""
    return [hybrid.step(at(index / hz), {}) for index in range(count)]


class Scripted(MadeOdometry):
    name = "scripted"

    def __init__(self, *motions):
        self.motions = list(motions)

    def step(self, frame, features, prior=None):
        return self.motions.pop(0)

    def step_blind(self, stamp_s, reason, attitude=None):
        return blind_motion(reason)


def motion(x_m, sigma_m, yaw_rad=0.0, fault=""):
    state = MotionState.BLIND if fault else MotionState.MEASURED
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.01**2])
    return Motion(SE2(x_m, 0.0, yaw_rad), covariance, (made(fault),) if fault else (), state)


def test_who_fails_is_left_out_and_its_fault_with_it():
    start, good = motion(0.0, 1.0), motion(0.1, 0.01)
    failed = motion(9.0, 0.5, fault="window odometry: nothing agrees")
    hybrid = of(camera=[start, failed, good], wheels=[start, good, good])
    _, second, third = (hybrid.step(FRAME, {}) for _ in range(3))
    assert (second.motion.x_m, texts(second.faults)) == (0.1, "window odometry: nothing agrees")
    assert (third.faults, third.covariance[0, 0]) == ((), pytest.approx(LASTING * 1e-4 / (1.0 + 1.0 / LASTING)))


def test_when_all_fail_the_motion_is_a_guess_that_names_them_all():
    start, lost, silent = motion(0.0, 1.0), motion(0.2, 1.0, fault="lost"), motion(0.0, 1.0, fault="no wheels")
    _, found = steps_of(of(camera=[start, lost], wheels=[start, silent]), 2)
    assert (texts(found.faults), found.blind) == ("lost; no wheels", True)


def test_a_motion_that_tells_less_than_a_guess_is_not_counted():
    """A metre is what is believed of a step that nobody measured; a sure member of another source stays alone."""
    start, loose = motion(0.0, 1.0), motion(0.3, 12.0)
    beside = {"wheels": [start, motion(0.1, 0.01)]}
    for wheels, members in (({}, {"camera": "blind"}), (beside, {"camera": "blind", "wheels": "used"})):
        _, found = steps_of(of(camera=[start, loose], **wheels), 2)
        assert found.covariance[0, 0] <= 1.0
        assert dict(found.members) == members
        assert found.blind == (not wheels)


def at(stamp_s):
    return Frame(round(10 * stamp_s), stamp_s, FRAME.image)


def test_a_guess_coasts_for_a_moment_and_rests_then():
    camera = [motion(0.0, 1.0), motion(0.1, 0.01), *[motion(0.0, 1.0, fault="lost")] * 13]
    steps = steps_of(of(camera=camera), 15)
    assert [step.state for step in steps] == [MotionState.UNMEASURED, MotionState.MEASURED] + [MotionState.BLIND] * 13
    assert [step.motion.x_m > 0.0 for step in steps[2:]] == [True] * 10 + [False] * 3


def test_an_uncertain_last_motion_is_not_repeated_while_nothing_is_seen():
    """Home 9000: a robot turns away from the last few corners, whose motion is off by three times the others'."""
    camera = [motion(0.0, 1.0), *[motion(0.05, 0.002)] * 20, motion(0.15, 0.05), *[motion(0.0, 1.0, fault="lost")] * 5]
    for step in steps_of(of(camera=camera), 27)[22:]:
        assert step.motion.x_m == pytest.approx(0.05, abs=0.02)


@pytest.mark.parametrize(("agreed", "told"), [([], 10), ([7], 17)])
def test_sources_that_go_on_disagreeing_are_a_fault_unless_a_step_agrees_between(agreed, told):
    """Ten steps of conflict until it is said; one of agreement after six begins again."""
    agree, deny = motion(0.1, 0.001), motion(0.3, 0.001)
    wheels = [agree if index in agreed else deny for index in range(told + 2)]
    faults = [texts(step.faults) for step in steps_of(of(camera=[agree] * (told + 2), wheels=wheels), told + 2)]
    assert [index for index, fault in enumerate(faults) if fault] == [told]
    assert "camera against wheels" in faults[told]


def test_the_covariance_of_a_lasting_conflict_covers_either_source():
    """A camera that shows one picture again and again beside wheels that roll: half of the path is missed."""
    moved = steps_of(of(camera=[motion(0.0, 0.002)] * 31, wheels=[motion(0.07, 0.002)] * 31), 31)[1:]
    off_m = sum(step.motion.x_m for step in moved) - 0.07 * 30
    assert off_m == pytest.approx(-1.05, abs=0.05)
    assert 1.0 < math.sqrt(sum(step.covariance[0, 0] for step in moved)) / abs(off_m) < 1.5


def test_blind_of_everything_it_carries_on_for_a_second_and_its_doubt_covers_any_motion():
    """0.1 m a step at 10 Hz; then 3 s without a picture: 1 m is carried on, 3 m may have been driven."""
    hybrid = of(camera=[motion(0.1, 0.01)] * 3)
    steps_of(hybrid, 3)
    steps = [hybrid.step_blind(0.2 + k / 10, made("no picture")) for k in range(1, 31)]
    assert all(step.blind for step in steps)
    assert [texts(step.faults) for step in steps] == ["no picture", *[""] * 29]
    assert sum(step.motion.x_m for step in steps) == pytest.approx(1.0)
    assert 3.0 < math.sqrt(sum(step.covariance[0, 0] for step in steps)) < 6.0


def beside_a_gyro(camera, rotation):
    """A hybrid of scripted pictures and a gyro after two steps, the second's motion, and the attitude of both."""
    hybrid = fusing(camera=Scripted(*camera), gyro=GyroOdometry())
    attitude = replace(Attitude(0.0, 0.0, np.zeros((2, 2))), rotation=rotation)
    _, found = (hybrid.step(at(index / 10), {}, FramePrior(attitude)) for index in range(2))
    return hybrid, found, attitude


def test_the_gyro_alone_gives_yaw_and_leaves_the_way_unknown():
    """Blind with a gyro: yaw is measured to 0.01 rad, 3 s of unknown speed stay unknown."""
    hybrid, _, attitude = beside_a_gyro([motion(0.1, 0.01, 0.05)] * 2, GyroRotation(np.eye(3), 0.05, 0.01))
    steps = [hybrid.step_blind(0.1 + k / 10, made("no picture"), attitude) for k in range(1, 31)]
    assert sum(step.motion.yaw_rad for step in steps) == pytest.approx(30 * 0.05, abs=5e-3)
    assert sum(step.covariance[2, 2] for step in steps) < LASTING**2 * 30 * 0.01**2
    assert 3.0 < math.sqrt(sum(step.covariance[0, 0] for step in steps)) < 6.0
    assert texts(steps[0].faults) == "no picture"


def test_a_camera_that_is_covered_in_part_counts_less_than_wheels():
    motions = {"camera": motion(0.02, 0.005), "wheels": motion(0.07, 0.002)}
    moved = {}
    for covered in (0.0, 0.7):
        hybrid = of(**{source: [found, found] for source, found in motions.items()})
        for stamp_s in (0.0, 0.1):
            moved[covered] = hybrid.step(at(stamp_s), {}, FramePrior(covered=covered)).motion.x_m
    assert moved[0.0] == pytest.approx(0.045, abs=0.003)  # between both
    assert moved[0.7] == pytest.approx(0.07, abs=0.001)


ANSWERS = {(True, False): False, (True, None): True, (None, None): None, (True, True): True, (False, None): False}


@pytest.mark.parametrize(("answers", "still"), ANSWERS.items())
def test_it_stands_still_where_every_source_that_measures_rest_reports_it(answers, still):
    sources = {}
    for name, answer in zip(("camera", "wheels"), answers, strict=True):
        sources[name] = Scripted()
        sources[name].still = lambda stamp_s, attitude, answer=answer: answer
    assert fusing(**sources).still(0.1, None) is still


def test_each_step_states_who_was_used_who_was_blind_and_who_was_left_out():
    """Camera and wheels agree; then the camera is lost; then the gyro outvotes spinning wheels; then all are lost."""
    start, agrees, lost = motion(0.0, 1.0), motion(0.1, 0.001), motion(0.0, 1.0, fault="lost")
    hybrid = of(
        camera=[start, agrees, lost, agrees, lost],
        wheels=[start, agrees, agrees, motion(0.3, 0.001, 0.3), lost],
        gyro=[start, agrees, agrees, agrees, lost],
    )
    found = [hybrid.step(at(index / 10), {}).members for index in range(5)]
    assert found[1:] == [
        {"camera": "used", "wheels": "used", "gyro": "used"},
        {"camera": "blind", "wheels": "used", "gyro": "used"},
        {"camera": "used", "wheels": "left_out", "gyro": "used"},
        {"camera": "blind", "wheels": "blind", "gyro": "blind"},
    ]


def test_the_gyro_is_told_what_the_others_measured_and_not_its_own_yaw():
    camera = [motion(0.1, 0.01, 0.02)] * 2
    hybrid, found, attitude = beside_a_gyro(camera, GyroRotation(np.eye(3), 0.03, 0.001))
    assert found.motion.yaw_rad == pytest.approx(0.03, abs=2e-4)
    moved = found.moved()
    assert (moved[0].yaw_rad, moved[1][2, 2]) == pytest.approx((0.02, LASTING * 1e-4))
    assert hybrid.step_blind(0.2, made("dark"), attitude).moved() is None


def test_a_gyro_that_is_not_confirmed_has_no_weight_beside_the_camera():
    """A late one says that the robot rests as it begins to turn."""
    camera = [motion(0.0, 1.0), motion(0.1, 0.01, 0.1)]
    _, found, _ = beside_a_gyro(camera, GyroRotation(np.eye(3), 0.0, 0.001, proved=False))
    assert found.motion.yaw_rad == pytest.approx(0.1, abs=1e-4)


def test_its_heading_is_held_to_the_room_that_the_edges_show():
    """A yaw that errs by 0.5 degrees a step, 30 degrees after 60, in a room that is seen every fifth."""
    headings = {}
    for edged in (False, True):
        steps = [motion(0.05, 0.01, math.radians(0.5)) for _ in range(61)]
        hybrid, heading = of(camera=steps), 0.0
        for index in range(61):
            room = RoomAxes(0.4, math.radians(0.6), np.zeros(3), index / 10.0) if edged and index % 5 == 0 else None
            attitude = Attitude(0.0, 0.0, np.eye(2), room=room)
            found = hybrid.step(replace(FRAME, index=index, stamp_s=index / 10.0), {}, FramePrior(attitude))
            heading += found.motion.yaw_rad if index else 0.0
        headings[edged] = math.degrees(heading)
    assert headings[False] == pytest.approx(30.0)
    assert abs(headings[True]) < 10.0  # two seconds of its drift
