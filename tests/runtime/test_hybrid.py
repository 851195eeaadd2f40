import numpy as np
import pytest

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.hybrid import HybridOdometry, Member
from edgemap.runtime.odometry.protocol import Motion

FRAME = Frame(0, 0.0, np.zeros((4, 4, 3), np.uint8))


class Scripted:
    name = "scripted"

    def __init__(self, *motions):
        self.motions, self.resets = list(motions), 0

    def step(self, frame, features):
        return self.motions.pop(0)

    def reset(self, reason):
        self.resets += 1


def motion(x_m, sigma_m, yaw_rad=0.0, fault=""):
    return Motion(SE2(x_m, 0.0, yaw_rad), np.diag([sigma_m**2, sigma_m**2, 0.01**2]), fault)


def test_who_fails_is_left_out_and_its_fault_with_it():
    start = motion(0.0, 1.0)
    camera = Scripted(start, motion(9.0, 0.5, fault="planar odometry: nothing agrees"), motion(0.1, 0.01))
    wheels = Scripted(start, motion(0.1, 0.01), motion(0.1, 0.01))
    hybrid = HybridOdometry([Member(camera, "camera"), Member(wheels, "wheels")])
    hybrid.step(FRAME, {})
    second = hybrid.step(FRAME, {})
    assert (second.motion.x_m, second.fault) == (0.1, "")
    assert hybrid.step(FRAME, {}).covariance[0, 0] == pytest.approx(0.5e-4)


def test_when_all_fail_the_first_ones_guess_and_fault_stand():
    start, lost = motion(0.0, 1.0), motion(0.2, 1.0, fault="lost")
    wheels = Scripted(start, motion(0.0, 1.0, fault="no wheels"))
    hybrid = HybridOdometry([Member(Scripted(start, lost), "camera"), Member(wheels, "wheels")])
    hybrid.step(FRAME, {})
    assert hybrid.step(FRAME, {}).fault == "lost"


def test_reset_reaches_every_member():
    members = Scripted(), Scripted()
    HybridOdometry([Member(member, "camera") for member in members]).reset("gap")
    assert [member.resets for member in members] == [2, 2]


def test_a_doubted_member_counts_less():
    start = motion(0.0, 1.0)
    sure, doubted = Scripted(start, motion(0.10, 0.01)), Scripted(start, motion(0.12, 0.01))
    hybrid = HybridOdometry([Member(sure, "camera"), Member(doubted, "wheels", doubt=4.0)])
    hybrid.step(FRAME, {})
    fused = hybrid.step(FRAME, {})
    assert fused.motion.x_m == pytest.approx(0.104)  # weights 4 to 1
    assert fused.covariance[0, 0] == pytest.approx(8e-5)
