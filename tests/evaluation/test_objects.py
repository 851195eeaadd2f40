import numpy as np
import pytest

from edgemap.evaluation.objects import TrueObject, reliability, score_map
from edgemap.geometry.map_object import MapObject


def mapped(label, x, y, sigma=0.1):
    return MapObject(f"{label}-1", label, np.array([x, y]), np.eye(2) * sigma**2, 0.5, 0.9, 9, 1.0, 0.0, 1.0)


def true(label, x, y, on_floor=True, frames=50):
    return TrueObject(label, x, y, on_floor, frames)


def test_by_hand():
    """Two chairs found (0.1 m and 0.3 m off), one missed, one couch invented; the second outside its ellipse."""
    objects = [mapped("chair", 1.1, 0), mapped("chair", 2.3, 0), mapped("couch", 5, 5)]
    truth = [true("chair", 1, 0), true("chair", 2, 0), true("chair", 9, 9)]
    figures = score_map(objects, truth)
    assert figures["precision"] == pytest.approx(2 / 3, abs=1e-4)
    assert figures["recall"] == pytest.approx(2 / 3, abs=1e-4)
    assert figures["median_error_m"] == pytest.approx(0.2)
    assert figures["covered95"] == 0.5
    assert figures["per_class"]["couch"]["precision"] == 0.0
    assert figures["per_class"]["couch"]["recall"] is None


def test_one_object_serves_one_truth_only():
    figures = score_map([mapped("chair", 1, 0), mapped("chair", 1.1, 0)], [true("chair", 1, 0)])
    assert (figures["precision"], figures["recall"]) == (0.5, 1.0)


def test_the_most_pairs_win_over_the_nearest():
    """Greedy would take the 0.1 m pair and leave the other object without a partner."""
    objects = [mapped("chair", 0.4, 0), mapped("chair", 0.0, 0)]
    truth = [true("chair", 0.5, 0), true("chair", 0.85, 0)]
    assert score_map(objects, truth)["objects_found"] == 2


def test_too_far_or_another_class_is_no_match():
    assert score_map([mapped("chair", 0, 0.51)], [true("chair", 0, 0)])["f1"] == 0.0
    assert score_map([mapped("couch", 0, 0)], [true("chair", 0, 0)])["f1"] == 0.0


def test_what_was_hardly_seen_is_neither_hit_nor_miss():
    figures = score_map([mapped("chair", 0, 0)], [true("chair", 0, 0, frames=9), true("chair", 5, 5, frames=3)])
    assert (figures["objects_mapped"], figures["objects_true"], figures["f1"]) == (0, 0, None)
    assert score_map([], [true("chair", 0, 0, frames=10)])["objects_true"] == 1


def test_what_is_not_on_the_floor_is_a_false_positive():
    figures = score_map([mapped("tv", 0, 0)], [true("tv", 0, 0, on_floor=False)])
    assert (figures["precision"], figures["objects_true"]) == (0.0, 0)


def test_consistency_counts_every_mapped_object_near_a_true_one():
    """Off by 0.1 m (matched), 0.8 m (a duplicate), 0.3 m (hardly seen) at a sigma of 0.1 m; 1.6 m does not count."""
    objects = [mapped("chair", 1.1, 0), mapped("chair", 1.8, 0), mapped("chair", 7.3, 0), mapped("chair", 2.6, 0)]
    truth = [true("chair", 1, 0), true("chair", 7, 0, frames=3), true("couch", 2.6, 0)]
    figures = score_map(objects, truth)
    assert figures["anees"] == pytest.approx((1.0 + 64.0 + 9.0) / 3 / 2, abs=1e-4)
    assert figures["ellipse_m2"] == pytest.approx(np.pi * 5.991 * 0.1**2, abs=1e-4)
    assert figures["per_class"]["couch"]["anees"] is None


def test_normalised_nees_is_one_where_covariances_are_right():
    rng = np.random.default_rng(1)
    covariance = np.array([[0.04, 0.01], [0.01, 0.02]])
    offsets = rng.multivariate_normal((0, 0), covariance, 400)
    objects = [
        MapObject(str(i), "bed", np.array([10.0 * i, 0]) + offset, covariance, 0.5, 0.9, 9, 1.0, 0.0, 1.0)
        for i, offset in enumerate(offsets)
    ]
    figures = score_map(objects, [true("bed", 10.0 * i, 0) for i in range(400)])
    assert figures["anees"] == pytest.approx(1.0, abs=0.15)


def test_reliability_by_hand():
    """Two of 0.95 and 0.93 of which one is real, one of 0.55 that is, one of 1.0 that is: |1 - 1.88| in a bin of its
    own with the 1.0, so |2 - 2.88| + |1 - 0.55| of four."""
    told = reliability([(0.95, True), (0.93, False), (0.55, True), (1.0, True)])
    assert [(one["from"], one["objects"], one["real"]) for one in told["bins"]] == [(0.5, 1, 1), (0.9, 3, 2)]
    assert told["ece"] == pytest.approx((abs(2 - 2.88) + abs(1 - 0.55)) / 4, abs=1e-3)
    assert reliability([]) == {"ece": None, "bins": []}


def test_a_map_tells_how_true_its_confidences_are():
    """What was hardly seen is not judged; what is matched is real, and a second object on it is not."""
    objects = [mapped("chair", 1, 0), mapped("chair", 1.2, 0), mapped("chair", 7, 0)]
    truth = [true("chair", 1, 0), true("chair", 7, 0, frames=3)]
    (one,) = score_map(objects, truth)["reliability"]["bins"]
    assert (one["objects"], one["real"], one["mean_confidence"]) == (2, 1, 1.0)
