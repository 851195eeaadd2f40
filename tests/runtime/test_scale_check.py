"""Camera against wheels: a height that is wrong is told with the likelier one, slip and noise are not."""

import numpy as np
import pytest

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate
from edgemap.runtime.odometry.scale_check import ScaleCheck


def steps(scale, count=150, slip=0, sigma_m=0.0005, seed=0):
    """Faults of a robot that rolls 5 cm a step, its camera measuring `scale` times that; the last `slip` steps slip."""
    rng, check, told = np.random.default_rng(seed), ScaleCheck(0.6), []
    for index in range(count):
        rolled = 0.05 * (2.0 if index >= count - slip else 1.0)
        noise = rng.normal(0.0, [sigma_m, sigma_m, 0.002])
        camera = MotionEstimate(
            np.array([0.05 * scale, 0.0, 0.01]) + noise, np.diag([sigma_m, sigma_m, 0.002]) ** 2, "camera"
        )
        wheels = MotionEstimate(np.array([rolled, 0.0, 0.01]), np.diag([0.001, 0.001, 0.002]) ** 2, "wheels")
        told += [(index, text)] if (text := check.judge(camera, wheels)) else []
    return told


@pytest.mark.parametrize(("scale", "height"), [(1.3, "0.46"), (0.75, "0.80")])
def test_a_wrong_height_is_one_fault_with_the_likelier_one(scale, height):
    found = steps(scale)
    assert len(found) == 1
    index, text = found[0]
    assert index < 100  # at 10 Hz within 10 s
    assert f"the lens would be {height} m above the floor, not 0.60 m" in text
    assert f"{100 * (scale - 1):+.0f} %" in text


def test_what_is_right_or_scatters_or_slips_for_a_moment_is_no_fault():
    assert not steps(1.0)
    assert not steps(1.08)
    assert not steps(1.0, slip=12)
    assert not steps(1.2, sigma_m=0.05)  # so little is stated that it may be true


def test_turns_and_holes_are_left_out():
    check, wheels = ScaleCheck(0.6), MotionEstimate(np.array([0.05, 0.0, 0.2]), np.eye(3) * 1e-6, "wheels")
    camera = MotionEstimate(np.array([0.10, 0.0, 0.2]), np.eye(3) * 1e-6, "camera")
    assert not any(check.judge(camera, wheels) for _ in range(200))
    straight = MotionEstimate(np.array([0.05, 0.0, 0.0]), np.eye(3) * 1e-6, "wheels")
    assert not any(check.judge(camera if i % 5 else None, straight) for i in range(200))
