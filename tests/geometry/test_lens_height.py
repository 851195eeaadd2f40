"""The mount as a drive shows it: height by sizes of objects, pitch and roll by motion."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTilt, MountTiltRule
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import HeightMeasurement, agreed_height, complete_boxes, lens_heights

NAMES = ("chair", "person", "tv")
CAMERA = FloorCamera(Intrinsics(640, 480, 400.0, 400.0, 319.5, 239.5), Mount(0.5, 0.1, 0.02))


def fall(column, row):
    """Slope of the ray through a pixel's place, positive down."""
    ((x, y, z),) = CAMERA.rays_base([(column - 0.5, row - 0.5)])
    return -z / math.hypot(x, y)


def box_of(label, column, foot, height_m):
    """The box of an object before a lens at this height; None where its top is above the picture."""
    f, (usual_m, _) = fall(column, foot), HEIGHT_M[label]
    depth_m = min(footprint_m(label, 0.0))
    # Higher than the lens its top is at the foot's range; lower, the far upper edge is seen.
    top = f * (1.0 - usual_m / height_m) / (1.0 if usual_m > height_m else 1.0 + f * depth_m / height_m)
    if fall(column, 5.0) >= top:
        return None
    return [column - 30, brentq(lambda row: fall(column, row) - top, 5.0, foot), column + 30, foot]


def detections(*boxes, label="chair", score=0.9):
    return Detections(
        np.array(boxes, dtype=float).reshape(-1, 4), np.full(len(boxes), score),
        np.full(len(boxes), NAMES.index(label), np.int64), NAMES,
    )  # fmt: skip


@given(st.sampled_from(["chair", "person"]), st.floats(40, 600), st.floats(300, 460), st.floats(0.2, 1.2))
def test_the_height_is_that_with_which_the_object_has_its_usual_height(label, column, foot, height_m):
    box = box_of(label, column, foot, height_m)
    if box is not None and foot - box[1] > 30.0:
        labels, rays = complete_boxes(detections(box, label=label), CAMERA)
        assert labels == [label]
        assert lens_heights(labels, rays) == (pytest.approx(height_m, rel=1e-6), pytest.approx(fall(column, foot)))


WHOLE = [300.0, 120.0, 360.0, 400.0]


@pytest.mark.parametrize(
    ("boxes", "options", "count"),
    [
        ([WHOLE], {}, 1),
        ([WHOLE], {"score": 0.4}, 0),
        ([WHOLE], {"label": "tv"}, 0),  # of no usual height
        ([[2.0, 120.0, 60.0, 400.0]], {}, 0),  # the picture cuts it, on each side
        ([[580.0, 120.0, 638.0, 400.0]], {}, 0),
        ([[300.0, 2.0, 360.0, 400.0]], {}, 0),
        ([[300.0, 120.0, 360.0, 478.0]], {}, 0),
        ([WHOLE, [330.0, 300.0, 420.0, 440.0]], {}, 1),  # the nearer one hides the other's foot
        ([[300.0, 200.0, 360.0, 212.0]], {}, 0),  # its foot is too near the horizon
    ],
)
def test_only_complete_boxes_whose_foot_shows_count(boxes, options, count):
    assert len(complete_boxes(detections(*boxes, **options), CAMERA)[0]) == count


def test_the_error_of_the_pitch_that_classes_share_does_not_average_out():
    """Weights 4 : 1, variances without the pitch 0.01 and 0.07, and 0.1 of each by the pitch."""
    one = HeightMeasurement("chair", 0.0, math.sqrt(0.02), 0.1)
    other = HeightMeasurement("person", 0.0, math.sqrt(0.08), 0.1)
    mean, sigma = agreed_height([one, other])
    assert mean == 0.0
    assert sigma**2 == pytest.approx(0.8**2 * 0.01 + 0.2**2 * 0.07 + 0.1**2)
    many = [HeightMeasurement(str(count), 0.0, math.hypot(0.2, 0.1), 0.1) for count in range(400)]
    assert agreed_height(many)[1] == pytest.approx(math.hypot(0.2 / 20.0, 0.1))
    assert agreed_height([one])[1] == pytest.approx(one.sigma)


def test_the_covariance_is_that_of_an_information_filter():
    """Up by edges and a turn of 1 rad, with the standard deviations of the rule."""
    rule = MountTiltRule()
    tilt = MountTilt.prior(rule).by_up("edges", np.zeros(2)).by_turn(np.array([0.0, 0.0, 1.0]))
    chord = math.sin(0.5) / 0.5
    expected = np.eye(2) * (rule.prior**-2 + rule.seen**-2 + chord**2 / (2.0 * rule.nod**2))
    np.testing.assert_allclose(np.linalg.inv(tilt.covariance), expected, rtol=1e-9)


def test_one_wrong_witness_among_many_counts_little():
    tilt = MountTilt.prior(MountTiltRule())
    for _ in range(10):
        tilt = tilt.by_up("edges", np.radians([0.2, 1.0]))
    wrong = tilt.by_up("edges", np.radians([15.0, -20.0]))
    assert np.degrees(np.abs(wrong.error_rad - tilt.error_rad)).max() < 0.6
