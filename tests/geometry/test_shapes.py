"""What is usual for a class, in numbers worked out by hand."""

import pytest

from edgemap.geometry.observations.class_extents import FOOTPRINT_M, MEASURED, shape_of


def test_every_measured_class_has_a_usual_footprint():
    assert MEASURED.keys() <= FOOTPRINT_M.keys()


def test_the_middle_lies_behind_the_edge_by_what_was_measured():
    """Couch: 0.87 - 0.15 x 1.61 = 0.6285 m; wider than 1.61 + 2 x 0.35 = 2.31 m counts as 2.31 m: 0.5235 m."""
    couch = shape_of("couch", 1.0)
    assert couch.reach_m(1.61) == pytest.approx(0.6285)
    assert couch.reach_m(9.0) == pytest.approx(0.5235)


def test_what_was_not_measured_is_guessed_from_the_footprint():
    """Bench, 1.40 x 0.50 m: the middle is half the depth behind the edge, 0.25 m, however wide it looks."""
    bench = shape_of("bench", 3.0)
    assert (bench.reach_m(0.2), bench.reach_m(3.0), bench.width) == pytest.approx((0.25, 0.25, 0.95))
    assert bench.width_sigma == pytest.approx(0.42)
