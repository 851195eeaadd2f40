"""Sightings from boxes: places and sizes by hand, hidden feet, usual shapes, ranges by depth, worktops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import FOOTPRINT_M, MEASURED, shapes_of
from edgemap.geometry.observations.detections import Detections, share_covered
from edgemap.geometry.observations.feet import box_ranges
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.occlusion import covered
from edgemap.geometry.observations.sighting import BoxEvidence, FloorRule, is_worktop, sightings_of

NAMES = ("chair", "person", "vase", "dining table", "tv", "refrigerator", "suitcase", "couch")
CAMERA = FloorCamera(Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5), Mount(1.0, 0.0, 0.0, 0.2, 0.0))
SCORED = BoxEvidence(full_weight_score=0.8)


def seen(*boxes):
    """Detections from (label, x0, y0, x1, y1)."""
    corners = np.array([box[1:] for box in boxes], dtype=float).reshape(-1, 4)
    ids = np.array([NAMES.index(box[0]) for box in boxes], dtype=np.int64)
    return Detections(corners, np.full(len(boxes), 0.9), ids, NAMES)


TABLE, CHAIR = ("dining table", 200, 250, 440, 400), ("chair", 270, 100, 370, 400)
STANDING = [  # boxes, rule, rows of those that stand on the floor
    ([], FloorRule(), []),
    ([("chair", 270, 100, 370, 239)], FloorRule(), []),  # above the horizon
    ([("chair", 300, 100, 340, 240.3)], FloorRule(), []),  # ends at it
    ([("chair", 270, 100, 370, 242)], FloorRule(), []),  # may end at it
    ([("chair", 300, 230, 340, 252)], FloorRule(), [0]),  # 40 m away
    ([("chair", 270, 100, 370, 478)], FloorRule(), [0]),  # cut by the lower border: nearer than the floor that is seen
    ([("chair", 270, 100, 370, 470)], FloorRule(), [0]),
    # On a table or beside it. The table is 150 rows high: its lowest 15 % begin at row 377.5.
    ([TABLE, ("vase", 300, 200, 330, 270)], FloorRule(), [0]),
    ([TABLE, ("vase", 500, 300, 530, 380)], FloorRule(), [0, 1]),
    ([TABLE, ("vase", 300, 310, 330, 370)], FloorRule(), [0]),
    ([TABLE, ("vase", 300, 330, 330, 390)], FloorRule(), [0, 1]),
    # 160 px at 5 m are 1.6 m: a couch called a suitcase. Near the horizon the range may be at fault.
    ([("suitcase", 240, 240, 400, 340)], FloorRule(), []),
    ([("couch", 240, 240, 400, 340)], FloorRule(), [0]),
    ([("suitcase", 312, 200, 328, 252)], FloorRule(), [0]),
    # A part of a chair, and a chair behind it.
    ([CHAIR, ("chair", 300, 250, 365, 396)], FloorRule(), [0]),
    ([("chair", 250, 100, 390, 400), ("chair", 300, 150, 365, 340)], FloorRule(), [0, 1]),
    ([("chair", 100, 200, 160, 400), ("chair", 400, 200, 460, 400)], FloorRule(), [0, 1]),
    # Both 5 m away, 0.2 m apart: 0.6 of the smaller box is shared, then all of it.
    ([("chair", 290, 240, 340, 340), ("chair", 310, 240, 360, 340)], FloorRule(), [0, 1]),
    ([("chair", 290, 240, 340, 340), ("chair", 292, 260, 330, 340)], FloorRule(), [0]),
]


@pytest.mark.parametrize(("boxes", "rule", "rows"), STANDING)
def test_what_stands_on_the_floor(boxes, rule, rows):
    assert sorted(sighting.detection for sighting in sightings_of(seen(*boxes), CAMERA, rule)) == rows


def test_a_box_drawn_round_projected_points_leads_back_to_them():
    """The lens counts from pixel centres, boxes from pixel edges: a foot at pixel v is the box edge v + 0.5."""
    foot = np.array([[6.0, 0.4]])
    column, row = CAMERA.project(foot)[0] + 0.5
    (chair,) = sightings_of(seen(("chair", column - 20, row - 80, column + 20, row)), CAMERA, FloorRule())
    bearing = foot[0] - [0.2, 0.0]
    behind_m = 0.13 + 0.23 * chair.width_m
    assert chair.position_base_m == pytest.approx(foot[0] + behind_m * bearing / np.linalg.norm(bearing), abs=1e-6)


def test_a_box_cut_by_the_pictures_side_has_its_middle_where_the_class_is_usually_wide():
    """40 px seen at 5 m are 0.4 m; a chair looks 0.58 m wide, so its middle is 0.29 m left of the right edge. It lies
    0.13 + 0.23 * 0.4 m behind the lower edge."""
    (chair,) = sightings_of(seen(("chair", 0, 240, 40, 340)), CAMERA, FloorRule())
    right_edge_m = (319.5 - (40 - 0.5)) / 500.0 * 5.0
    across_m = chair.position_base_m[1] * (5.0 / (chair.position_base_m[0] - 0.2))  # back along the ray, to 5 m ahead
    assert across_m == pytest.approx(right_edge_m + 0.29)
    behind_m = np.linalg.norm(chair.position_base_m - [0.2, 0.0]) - math.hypot(5.0, across_m)
    assert behind_m == pytest.approx(0.222)
    (whole,) = sightings_of(seen(("chair", 10, 240, 68, 340)), CAMERA, FloorRule())
    assert chair.covariance_m2[1, 1] > 2.0 * whole.covariance_m2[1, 1]


def test_the_middle_of_what_the_picture_cuts_is_as_uncertain_along_the_ray_as_across():
    """A couch looks 1.61 m wide, with a standard deviation of 0.35 m. Cut on both sides it is 4 m wide and more, so
    nothing of its usual width is missing: half of 0.35 m remains."""
    (whole,) = sightings_of(seen(("couch", 4, 100, 636, 400)), CAMERA, FloorRule())
    (cut,) = sightings_of(seen(("couch", 0, 100, 640, 400)), CAMERA, FloorRule())
    assert cut.covariance_m2[0, 0] - whole.covariance_m2[0, 0] == pytest.approx(0.175**2, rel=1e-3)


def test_feet_below_the_picture_are_between_the_robot_and_the_nearest_floor_seen():
    """The last row shows the floor 500 / 240 = 2.083 m ahead: the lower edge is 1.142 +- 0.544 m away, anywhere between
    that and 0.2 m. 290 px would be 1.208 m there, a chair looks 0.58 +- 0.14 m wide: 1.0 +- 0.241 m. Together 1.0233 m,
    where it is 0.5935 m wide, its middle 0.13 + 0.23 * 0.5935 m farther, and the ray of its upper edge, 100 px
    below the horizon, 1 - 0.2 * 1.0233 m high."""
    (chair,) = sightings_of(seen(("chair", 175, 340, 465, 480)), CAMERA, FloorRule(), evidence=SCORED)
    assert chair.position_base_m == pytest.approx([0.2 + 1.0233 + 0.2665, 0.0], abs=1e-3)
    assert chair.width_m == pytest.approx(0.5935, abs=1e-3)
    assert chair.height_m == pytest.approx(1.0 - 0.2 * 1.0233, abs=1e-3)
    assert chair.covariance_m2[0, 0] == pytest.approx(0.5437**2 * 0.2414**2 / (0.5437**2 + 0.2414**2), rel=0.01)
    assert chair.weight == pytest.approx(0.5)  # a part of it is seen, which counts half
    (whole,) = sightings_of(seen(("chair", 175, 340, 465, 470)), CAMERA, FloorRule(), evidence=SCORED)
    assert whole.weight == pytest.approx(1.0)


def test_a_hidden_lower_edge_is_doubted_and_the_usual_width_says_how_far_it_is():
    """A chair that would be twice as wide as chairs look: with nearer furniture before its feet it is believed to stand
    nearer, and doubted."""
    chair, table = ("chair", 285, 240, 355, 300), ("dining table", 200, 260, 440, 400)
    (plain,) = sightings_of(seen(chair), CAMERA, FloorRule())
    hidden = next(s for s in sightings_of(seen(chair, table), CAMERA, FloorRule()) if s.label == "chair")
    assert plain.width_m == pytest.approx(1.167, abs=1e-3)  # twice as wide as chairs look: it must be nearer
    assert hidden.covariance_m2[0, 0] > 3.0 * plain.covariance_m2[0, 0]
    assert hidden.position_base_m[0] < plain.position_base_m[0] - 0.5
    assert hidden.distance_m < plain.distance_m - 0.5  # as it stands nearer


def test_a_foot_behind_what_is_no_floor_is_between_that_and_the_lower_edge():
    """The lower edge is 3.333 m away; what is no floor below it stands 2.5 m away: 2.917 +- 0.241 m. A chair looks 0.58
    +- 0.14 m wide, so 80 px say 3.625 +- 0.875 m: together 2.966 m, where it is 0.475 m wide."""
    box, floor = seen(("chair", 280, 240, 360, 390)), np.zeros((96, 64), dtype=np.float32)
    floor[88:] = 1.0
    (hidden,) = sightings_of(box, CAMERA, FloorRule(), evidence=SCORED, floor=FloorMask(floor, 640, 480))
    floor[79:] = 1.0
    (standing,) = sightings_of(box, CAMERA, FloorRule(), evidence=SCORED, floor=FloorMask(floor, 640, 480))
    assert standing.position_base_m[0] == pytest.approx(0.2 + 3.333 + 0.13 + 0.23 * 0.533, abs=2e-3)
    assert hidden.position_base_m[0] == pytest.approx(0.2 + 2.966 + 0.13 + 0.23 * 0.475, abs=2e-3)
    assert hidden.covariance_m2[0, 0] == pytest.approx(1.0 / (1.0 / 0.2406**2 + 1.0 / 0.875**2), rel=0.02)
    assert (hidden.weight, standing.weight) == (pytest.approx(0.5), pytest.approx(1.0))


@given(st.lists(st.tuples(*[st.floats(0, 640)] * 4), min_size=1, max_size=6))
def test_a_covered_share_is_the_share_of_columns_behind_nearer_boxes(corners):
    boxes = np.array([[min(a, c), min(b, d), max(a, c) + 2, max(b, d) + 2] for a, b, c, d in corners])
    x0, _, x1, y1 = boxes[0]
    columns = np.linspace(x0, x1, 20001)
    behind = np.zeros(len(columns), dtype=bool)
    for left, top, right, bottom in boxes[1:]:
        if bottom > y1 + 3 and top < y1:
            behind |= (columns >= left) & (columns <= right)
    assert covered(boxes, 0) == pytest.approx(behind.mean(), abs=1e-3)


def test_usual_shapes_and_where_their_middle_lies():
    assert MEASURED.keys() <= FOOTPRINT_M.keys()
    # Couch: 0.87 - 0.15 x 1.61 = 0.6285 m; wider than 1.61 + 2 x 0.35 = 2.31 m counts as 2.31 m: 0.5235 m.
    couch = shapes_of(["couch"], np.ones(1))
    assert couch.reach_m(1.61) == pytest.approx(0.6285)
    assert couch.reach_m(9.0) == pytest.approx(0.5235)
    # Bench, 1.40 x 0.50 m: the middle is half the depth behind the edge, 0.25 m, however wide it looks.
    bench = shapes_of(["bench"], np.full(1, 3.0))
    assert [*bench.reach_m(np.array([0.2, 3.0])), *bench.width] == pytest.approx([0.25, 0.25, 0.95])
    assert bench.width_sigma == pytest.approx(0.42)


WIDE = FloorCamera(Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5), Mount(1.0, 0.0))
BOX = np.array([[220.0, 120.0, 420.0, 320.0]])  # its lower edge is floor from 6.2 m on


@pytest.mark.parametrize(
    ("near", "known", "range_m"),
    [
        (1.0, 1.0, 2.0),
        (0.55, 1.0, 2.0),  # what shows through, 4 m away, is not the object
        (0.2, 1.0, 4.0),  # nor is what stands before a part of it
        (1.0, 0.4, 2.0),
        (1.0, 0.15, 0.0),
    ],
)
def test_the_range_is_that_of_the_nearer_part_that_is_large_enough(near, known, range_m):
    """near: share of the columns that show something 2 m away, the others 4 m. known: share of the rows with depth."""
    depth = np.full((480, 640), 4.0, np.float32)
    depth[:, : 220 + 40 + round(120 * near)] = 2.0  # the box is read from a fifth of it to four fifths
    depth[120 + round(30 + 150 * known) :] = 0.0
    ((found_m, sigma_m),) = box_ranges(depth, BOX, WIDE)
    assert found_m == pytest.approx(range_m, rel=0.02)
    assert 0.0 < sigma_m < 0.1 * range_m or (range_m, sigma_m) == (0.0, np.inf)


KITCHEN = ("chair", "cup")
LOWER_HALF = FloorMask(np.repeat([[0.0], [1.0]], 8, axis=1).repeat(3, axis=0).astype(np.float32), 640, 480)


def box(label, foot_px):
    box = np.array([[300.0, foot_px - 50.0, 340.0, foot_px]])
    return Detections(box, np.array([0.9]), np.array([KITCHEN.index(label)]), KITCHEN)


def test_a_cup_on_the_mask_shows_a_worktop():
    assert [is_worktop(LOWER_HALF, box("cup", foot_px)) for foot_px in (200.0, 400.0, 480.0)] == [False, True, True]
    assert not is_worktop(LOWER_HALF, box("chair", 400.0))
    assert not is_worktop(None, box("cup", 400.0))
    assert not is_worktop(LOWER_HALF, Detections.none(KITCHEN))


@pytest.mark.parametrize(
    ("boxes", "share"),
    [
        ([], 0.0),
        ([[0, 0, 320, 240]], 1.0),
        ([[-50, -50, 160, 240]], 0.5),
        ([[0, 0, 160, 240], [80, 0, 240, 240]], 0.75),  # together, not one after the other
        ([[160, 112, 400, 400]], 0.5 * 8 / 15),
    ],
)
def test_boxes_cover_a_share_of_the_picture_together(boxes, share):
    assert share_covered(np.array(boxes, dtype=float).reshape(-1, 4), 320, 240) == pytest.approx(share)
