import numpy as np
import pytest

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.hybrid import HybridOdometry, fuse
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


def test_two_that_agree_are_weighted_by_what_they_know():
    """0.10 +- 0.01 and 0.12 +- 0.02: weights 4 to 1, so 0.104; variance 1 / (1e4 + 2.5e3) = 8e-5."""
    fused = fuse(motion(0.10, 0.01), motion(0.12, 0.02))
    assert fused.motion.x_m == pytest.approx(0.104)
    assert fused.covariance[0, 0] == pytest.approx(8e-5)


def test_two_that_disagree_leave_the_later_one_in_doubt():
    fused = fuse(motion(0.10, 0.001), motion(0.30, 0.001))
    assert fused.motion.x_m == 0.30
    assert fused.covariance[0, 0] == pytest.approx(0.001**2 + 0.2**2 / 4)


def test_yaw_is_compared_round_the_circle():
    fused = fuse(motion(0.0, 0.01, 3.14159), motion(0.0, 0.01, -3.14159))
    assert abs(abs(fused.motion.yaw_rad) - np.pi) < 1e-4


def test_who_fails_is_left_out_and_its_fault_with_it():
    start = motion(0.0, 1.0)
    camera = Scripted(start, motion(9.0, 0.5, fault="planar odometry: nothing agrees"), motion(0.1, 0.01))
    wheels = Scripted(start, motion(0.1, 0.01), motion(0.1, 0.01))
    hybrid = HybridOdometry([camera, wheels])
    hybrid.step(FRAME, {})
    second = hybrid.step(FRAME, {})
    assert (second.motion.x_m, second.fault) == (0.1, "")
    assert hybrid.step(FRAME, {}).covariance[0, 0] == pytest.approx(0.5e-4)


def test_when_all_fail_the_first_ones_guess_and_fault_stand():
    start, lost = motion(0.0, 1.0), motion(0.2, 1.0, fault="lost")
    hybrid = HybridOdometry([Scripted(start, lost), Scripted(start, motion(0.0, 1.0, fault="no wheels"))])
    hybrid.step(FRAME, {})
    assert hybrid.step(FRAME, {}).fault == "lost"


def test_reset_reaches_every_member():
    members = Scripted(), Scripted()
    HybridOdometry(members).reset("gap")
    assert [member.resets for member in members] == [2, 2]
