"""Footprints fitted to outlines that are made from a known rectangle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.map_object import MapObject, MeasuredFootprint, outline_m
from edgemap.geometry.objects.approach import approach
from edgemap.geometry.objects.footprint import FootprintRule, fitted
from edgemap.geometry.objects.merge import fused
from edgemap.geometry.se2 import wrap_angle
from edgemap.geometry.slam.object_landmarks import LandmarkRule
from edgemap.runtime.step.map_file import map_text, read_map

RULE = replace(FootprintRule(), margin_m=0.0)


def item(label: str, shape: MeasuredFootprint | None, at: tuple[float, float] = (3.0, 1.0)) -> MapObject:
    covariance = np.eye(2) * 0.01
    return MapObject(f"{label}-1", label, np.array(at), covariance, 1.0, 0.8, 9, 0.9, 0.0, 1.0, measured=shape)


def outline(corners: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Lens and both ends of the lower edge of the box round a rectangle, for a level camera that faces its middle."""
    forward = corners.mean(axis=0) - lens
    forward /= np.linalg.norm(forward)
    left = np.array([-forward[1], forward[0]])
    along, across = (corners - lens) @ forward, (corners - lens) @ left
    near, slopes = along.min(), across / along
    return np.array([lens, *(lens + near * (forward + slope * left) for slope in (slopes.max(), slopes.min()))])


@pytest.mark.parametrize("yaw_deg", [0, 35, 90, 140])
@pytest.mark.parametrize(("label", "size"), [("couch", (1.7, 0.8)), ("bed", (1.4, 2.1)), ("dining table", (1.6, 0.8))])
def test_a_rectangle_seen_from_several_sides_is_found(label: str, size: tuple[float, float], yaw_deg: int):
    true = item(label, MeasuredFootprint(size[0], size[1], math.radians(yaw_deg), 0.1))
    angles = np.radians(np.linspace(-90.0, 90.0, 7) + yaw_deg)
    views = true.position_m + 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    outlines = np.array([outline(outline_m(true), lens) for lens in views])
    found = fitted(label, 1.0, true.position_m + [0.1, -0.1], outlines, None, RULE)
    assert found is not None
    assert found.shape.yaw_rad is not None
    assert (found.shape.width_m, found.shape.depth_m) == pytest.approx(size, abs=0.1)
    assert found.offset_m == pytest.approx([-0.1, 0.1], abs=0.07)
    assert abs(wrap_angle(found.shape.yaw_rad - math.radians(yaw_deg))) < math.radians(6.0)
    assert found.shape.yaw_sigma_rad < RULE.unknown_rad


def test_what_no_box_outlines_is_a_circle():
    assert fitted("chair", 0.5, np.zeros(2), np.zeros((0, 3, 2)), None, RULE) is None
    circle = outline_m(item("chair", None))
    assert np.ptp(np.linalg.norm(circle - [3.0, 1.0], axis=1)) < 1e-9


@pytest.mark.parametrize("shape", [None, MeasuredFootprint(1.9, 0.8, 2.5, 0.2), MeasuredFootprint(0.7, 0.7)])
def test_a_footprint_survives_the_file_and_a_person_overrides_it(shape):
    before = item("couch", shape)
    (after,), _ = read_map(map_text([before]).encode(), "test")
    assert outline_m(after) == pytest.approx(outline_m(before), abs=1e-3)
    turned = replace(before, yaw_rad=1.0, depth_m=0.5, corrected=("yaw", "size"))
    (read,), _ = read_map(map_text([turned]).encode(), "test")
    assert outline_m(read) == pytest.approx(outline_m(turned), abs=1e-3)
    assert np.linalg.norm(outline_m(read)[0] - outline_m(read)[3]) == pytest.approx(0.5, abs=1e-3)


def test_the_surer_yaw_of_two_maps_stays_and_a_robot_stops_at_the_front():
    sure, unsure = (
        item("couch", MeasuredFootprint(2.0, 0.9, 0.5, 0.1)),
        item("couch", MeasuredFootprint(1.8, 0.9, 1.2, 0.4)),
    )
    assert fused(unsure, sure, LandmarkRule()).measured == sure.measured
    goal = approach(sure, [sure])
    assert math.atan2(goal.pose.y_m - 1.0, goal.pose.x_m - 3.0) == pytest.approx(0.5, abs=0.2)
