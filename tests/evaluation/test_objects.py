"""Maps against true objects: figures, verdicts of each object, footprints, alignment."""

import math

import cv2
import numpy as np
import pytest

from edgemap.evaluation.footprints import iou, score_footprints, yaw_error_deg
from edgemap.evaluation.map_alignment import aligned_figures
from edgemap.evaluation.objects import TrueObject, evaluation_rows, score_map
from edgemap.evaluation.rows import tally
from edgemap.geometry.map_object import MapObject, ObjectFootprint, outline_m


def mapped(name, x, y, sigma=0.1):
    label = name.partition("-")[0]
    return MapObject(name, label, np.array([x, y]), np.eye(2) * sigma**2, 0.5, 0.9, 9, 1.0, 0.0, 1.0)


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


@pytest.mark.parametrize(
    ("objects", "truth", "figures"),
    [
        # One object serves one truth only.
        ([("chair", 1, 0), ("chair", 1.1, 0)], [("chair", 1, 0)], {"precision": 0.5, "recall": 1.0}),
        # The most pairs win over the nearest: greedy would take the 0.1 m pair and leave the other without a partner.
        ([("chair", 0.4, 0), ("chair", 0.0, 0)], [("chair", 0.5, 0), ("chair", 0.85, 0)], {"objects_found": 2}),
        ([("chair", 0, 0.51)], [("chair", 0, 0)], {"f1": 0.0}),  # too far
        ([("couch", 0, 0)], [("chair", 0, 0)], {"f1": 0.0}),
        # What was hardly seen is neither hit nor miss.
        ([("chair", 0, 0)], [("chair", 0, 0, True, 9), ("chair", 5, 5, True, 3)],
         {"objects_mapped": 0, "objects_true": 0, "f1": None}),
        ([], [("chair", 0, 0, True, 10)], {"objects_true": 1}),
        # What is not on the floor is a false positive.
        ([("tv", 0, 0)], [("tv", 0, 0, False)], {"precision": 0.0, "objects_true": 0}),
    ],
)  # fmt: skip
def test_what_matches_what(objects, truth, figures):
    found = score_map([mapped(*one) for one in objects], [true(*one) for one in truth])
    assert {name: found[name] for name in figures} == figures


def test_consistency_counts_every_mapped_object_near_a_true_one():
    """Off by 0.1 m (matched), 0.8 m (a duplicate), 0.3 m (hardly seen) at a sigma of 0.1 m; 1.6 m does not count."""
    objects = [mapped("chair", 1.1, 0), mapped("chair", 1.8, 0), mapped("chair", 7.3, 0), mapped("chair", 2.6, 0)]
    truth = [true("chair", 1, 0), true("chair", 7, 0, frames=3), true("couch", 2.6, 0)]
    figures = score_map(objects, truth)
    assert figures["anees"] == pytest.approx((1.0 + 64.0 + 9.0) / 3 / 2, abs=1e-4)
    assert figures["ellipse_m2"] == pytest.approx(np.pi * 5.991 * 0.1**2, abs=1e-4)
    assert figures["per_class"]["couch"]["anees"] is None


def test_a_map_tells_how_true_its_confidences_are():
    """What was hardly seen is not judged; what is matched is real, and a second object on it is not."""
    objects = [mapped("chair", 1, 0), mapped("chair", 1.2, 0), mapped("chair", 7, 0)]
    truth = [true("chair", 1, 0), true("chair", 7, 0, frames=3)]
    (one,) = score_map(objects, truth)["reliability"]["bins"]
    assert (one["objects"], one["real"], one["mean_confidence"]) == (2, 1, 1.0)


def test_a_reliability_diagram_is_drawn_without_objects_too(tmp_path):
    charts = pytest.importorskip("edgemap.plots.charts", reason="figures need the extra 'plot'")
    bins = [{"from": 0.9, "to": 1.0, "objects": 4, "real": 3, "mean_confidence": 0.95}]
    for name, calibration in (("some", {"ece": 0.2, "bins": bins}), ("none", {"ece": None, "bins": []})):
        drawing = cv2.imread(str(charts.plot_reliability(tmp_path / f"{name}.png", calibration)))
        assert drawing.std() > 1.0


def test_every_state_by_hand():
    objects = [mapped("chair-1", 1.2, 0), mapped("chair-2", 4, 1.2), mapped("chair-3", 9, 9), mapped("couch-1", 1, 0)]
    truth = [true("chair", 1, 0), true("chair", 4, 0), true("bed", -3, 0), true("couch", 1, 0.1, frames=3)]
    rows = evaluation_rows(objects, truth)
    assert [(row.state, row.label, row.object_id) for row in rows] == [
        ("found", "chair", "chair-1"),
        ("misplaced", "chair", "chair-2"),
        ("missed", "bed", None),
        ("extra", "chair", "chair-3"),
        ("unscored", "couch", "couch-1"),
    ]
    assert [row.error_m for row in rows[:2]] == pytest.approx([0.2, 1.2])
    assert [row.covered for row in rows[:2]] == [True, False]  # 2 sigma inside the ellipse (2.45), 12 sigma not
    assert rows[2].true_m == (-3, 0)
    assert tally(rows) == "1 found, 1 misplaced, 1 missed, 1 extra, 1 unscored"


def test_too_far_for_misplaced_is_missed_and_extra_and_what_is_not_on_the_floor_is_extra():
    rows = evaluation_rows([mapped("chair-1", 1.6, 0)], [true("chair", 0, 0)])
    assert [row.state for row in rows] == ["missed", "extra"]
    rows = evaluation_rows([mapped("tv-1", 0, 0)], [true("tv", 0, 0, on_floor=False)])
    assert [row.state for row in rows] == ["extra"]


def test_the_table_agrees_with_the_score():
    random = np.random.default_rng(3)
    for _ in range(30):
        objects = [mapped(f"chair-{i}", *random.uniform(0, 3, 2)) for i in range(random.integers(0, 7))]
        truth = [true("chair", *random.uniform(0, 3, 2), frames=int(random.integers(5, 20))) for _ in range(5)]
        rows, figures = evaluation_rows(objects, truth), score_map(objects, truth)
        states = [row.state for row in rows]
        assert states.count("found") == figures["objects_found"]
        assert len(states) - states.count("missed") == len(objects)
        assert sum(states.count(name) for name in ("found", "misplaced", "missed")) == figures["objects_true"]


SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def test_overlap_and_turn_of_footprints_by_hand():
    assert iou(SQUARE, SQUARE[::-1]) == pytest.approx(1.0)
    assert iou(SQUARE, SQUARE + [0.5, 0.0]) == pytest.approx(1 / 3, abs=0.02)
    assert iou(SQUARE, SQUARE + [3.0, 0.0]) == 0.0
    assert yaw_error_deg(SQUARE[[1, 2, 3, 0]] * [1.0, 0.9], SQUARE) == pytest.approx(0.0)


def shaped(shape: ObjectFootprint | None, x_m: float = 2.0) -> MapObject:
    return MapObject("couch-1", "couch", np.array([x_m, 0.0]), np.eye(2), 1.0, 1.0, 9, 0.9, 0.0, 1.0, measured=shape)


def test_figures_of_one_couch():
    corners = outline_m(shaped(ObjectFootprint(2.0, 0.8, math.radians(10.0), 0.1)))
    truth = [TrueObject("couch", 2.0, 0.0, True, 20, tuple(map(tuple, corners.tolist())))]
    turned = score_footprints([shaped(ObjectFootprint(2.0, 0.8, math.radians(178.0), 0.1))], truth)
    assert turned["f1_iou25"] == 1.0
    assert turned["yaw_error_deg"] == pytest.approx(12.0, abs=0.1)
    circle = score_footprints([shaped(None)], truth)
    assert (circle["oriented"], circle["yaw_error_deg"]) == (0.0, None)
    assert circle["mean_iou"] < turned["mean_iou"]
    away = score_footprints([shaped(None, 9.0)], truth)
    assert (away["f1_iou25"], away["mean_iou"]) == (0.0, None)
    assert score_footprints([shaped(None)], [TrueObject("couch", 2.0, 0.0, True, 20)]) is None


ROOM = [
    ("chair", 0, 0), ("chair", 2, 0.5), ("chair", 5, 1), ("couch", 1, 3), ("bed", 6, 4), ("oven", 4, 5), ("vase", 3, 2),
]  # fmt: skip


def truth(room=ROOM):
    return [TrueObject(label, x, y, True, 50) for label, x, y in room]


def seen_as(room=ROOM, yaw=0.0, shift=(0.0, 0.0), scale=1.0):
    """The room as a map with another origin, heading and scale shows it."""
    rotation = scale * np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    places = [rotation @ np.array([x, y], dtype=float) + shift for _, x, y in room]
    return [
        MapObject(f"{label}-{row}", label, place, np.eye(2) * 0.01, 0.5, 0.9, 9, 1.0, 0.0, 1.0)
        for row, ((label, _, _), place) in enumerate(zip(room, places, strict=True))
    ]


def test_alignments_by_hand():
    """Another origin and heading; too large; a mirror image; too few pairs; empty maps; hundreds of one label."""
    objects = seen_as(yaw=0.7, shift=(3.0, -2.0))
    assert score_map(objects, truth())["f1"] < 0.3
    assert aligned_figures(objects, truth()) == {"f1_aligned": 1.0, "f1_scaled": 1.0, "scale": pytest.approx(1.0)}
    figures = aligned_figures(seen_as(yaw=-0.4, shift=(1.0, 1.0), scale=1.3), truth())
    assert figures["f1_scaled"] == 1.0
    assert figures["scale"] == pytest.approx(1.3, abs=1e-3)
    assert figures["f1_aligned"] < 1.0  # the outer objects are 0.9 m too far out
    mirrored = [(label, x, -y) for label, x, y in ROOM]
    assert aligned_figures(seen_as(mirrored), truth())["f1_scaled"] < 0.7
    few = ROOM[:4]
    figures = aligned_figures(seen_as(few, scale=1.2), truth(few))
    assert (figures["f1_scaled"], figures["scale"]) == (1.0, None)
    nothing = {"f1_aligned": 0.0, "f1_scaled": 0.0, "scale": None}
    assert aligned_figures([], truth()) == nothing
    assert aligned_figures(seen_as(), [])["f1_aligned"] == 0.0
    assert aligned_figures([], [])["f1_aligned"] is None
    assert aligned_figures(seen_as(ROOM[:1], shift=(0.2, 0.0)), truth(ROOM[:1]))["f1_aligned"] == 1.0
    many = [("bed", 1.5 * (i % 15), 1.5 * (i // 15)) for i in range(200)]
    assert aligned_figures(seen_as(many), truth(many))["f1_aligned"] == 1.0
