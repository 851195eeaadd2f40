import math

import numpy as np
import pytest

from edgemap.evaluation.trajectory import planar_fit


def pose(x, y, z, yaw=0.0, pitch=0.0):
    """Base to world, z up; pitch positive looking down."""
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    full = np.eye(4)
    full[:3, :3], full[:3, 3] = turn, (x, y, z)
    return full


def test_what_moves_in_the_plane_loses_nothing():
    angles = np.linspace(0, 3, 60)
    circle = np.array([pose(5 * math.sin(a), 5 - 5 * math.cos(a), 0, a) for a in angles])
    fit = planar_fit(circle, (2.0,))
    assert fit["max_m"] == pytest.approx(0.0, abs=1e-9)
    assert fit["t_rel_percent"] == pytest.approx(0.0, abs=1e-9)
    assert fit["height_max_m"] == 0.0


def test_a_hill_is_longer_than_its_shadow():
    # Up a slope of 0.1 rad with the nose along it: every motion is 1 m forward, seen from above cos(0.1).
    slope = np.array([pose(i * math.cos(0.1), 0, i * math.sin(0.1), 0, -0.1) for i in range(41)])
    fit = planar_fit(slope, (9.5, 100.0))
    assert fit["max_m"] == pytest.approx(40 * (1 - math.cos(0.1)))
    assert fit["mean_percent"] == pytest.approx(100 * 20 * (1 - math.cos(0.1)) / 40)
    assert fit["t_rel_percent"] == pytest.approx(100 * 10 * (1 - math.cos(0.1)) / 9.5)
    assert fit["height_max_m"] == pytest.approx(40 * math.sin(0.1))
    assert planar_fit(slope, (100.0,))["t_rel_percent"] is None
