import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.seen import CAMERA, box_of, look

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.forgetting import Forgetter
from edgemap.geometry.objects.visibility import ViewRule, expected_boxes, floor_in_place, in_plain_view, iou
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import FloorRule, PlacedSighting, sightings_of
from edgemap.geometry.se2 import SE2

NOTHING = Detections.none(("chair",))


def chair_map(distance_m=2.0):
    """The map of a standing robot with a chair straight ahead."""
    floor_map, random = FloorMap(), np.random.default_rng(0)
    for number in range(20):
        detections, _ = look([("chair", distance_m, 0.0)], SE2(), random, 1.0)
        found = sightings_of(detections, CAMERA, FloorRule(), number, number / 10)
        floor_map.update([PlacedSighting(sighting, SE2(), np.zeros((3, 3))) for sighting in found])
    return floor_map


def test_floor_is_in_place_where_it_shows_all_round_the_ellipse():
    """The ellipse lies along (1, 0.5): floor that is missing at its end counts, at the mirrored place it does not."""
    (chair,) = chair_map(3.0).objects()
    chair = replace(chair, position_m=np.array([3.0, 0.0]), covariance_m2=np.array([[0.2, 0.1], [0.1, 0.06]]))
    pose, lens = SE2(-0.5, 0.1, 0.05), CAMERA.intrinsics
    end = np.linalg.cholesky(chair.covariance_m2) @ [1.0, 0.0]

    def shown(item, *missing):
        cells = np.ones((lens.height // 8, lens.width // 8), np.float32)
        for place in missing:
            ((x, y),) = CAMERA.project(np.array([[*pose.inverse().apply(place), 0.0]]))
            cells[int(y // 8) - 1 : int(y // 8) + 2, int(x // 8) - 1 : int(x // 8) + 2] = 0.0
        return floor_in_place([item], CAMERA, pose, FloorMask(cells, lens.width, lens.height)).tolist()

    assert shown(chair) == [True]
    for missing in (chair.position_m, chair.position_m + end, chair.position_m - end):
        assert shown(chair, missing) == [False]
    assert shown(chair, chair.position_m + 1.5 * end * [1.0, -1.0]) == [True]
    assert shown(replace(chair, covariance_m2=np.eye(2) * 1e-6)) == [False]  # less than a cell of the mask


def test_the_expected_box_is_the_projected_cylinder():
    (chair,) = chair_map().objects()
    (box,) = expected_boxes([chair], CAMERA, SE2())
    x, y = chair.position_m
    true = box_of("chair", x, y, SE2())
    assert box == pytest.approx(true, abs=12.0)  # radius 0.28 m against 0.25 m, mean height against 0.7 m
    assert iou(true, box[None])[0] > 0.8
    assert np.isnan(expected_boxes([chair], CAMERA, SE2(0.0, 0.0, math.pi))).all()


@pytest.mark.parametrize(
    ("pose", "plain"),
    [
        (SE2(), True),
        (SE2(-0.3, 0.0, 0.1), False),  # farther than 0.9 of what it was ever seen from
        (SE2(0.3, 0.0, 0.0), True),
        (SE2(0.0, 0.0, 0.75), False),  # beside the picture
        (SE2(0.3, 0.0, 0.55), False),  # cut by the picture's right side alone
        (SE2(0.3, 0.0, -0.55), False),  # and by its left side
        (SE2(0.8, 0.0, 0.0), True),  # on the line along which it was seen
        (SE2(1.0, -0.9, 0.73), False),  # never seen from that side: a wall may stand between
        (SE2(0.0, 0.0, math.pi), False),
    ],
)
def test_plain_view_is_whole_near_and_known_from_here(pose, plain):
    objects = chair_map(2.2).objects()
    boxes = expected_boxes(objects, CAMERA, pose)
    rule = ViewRule()
    assert in_plain_view(objects, boxes, CAMERA, pose, NOTHING, rule).tolist() == [plain]


def test_what_a_nearer_box_or_a_nearer_object_hides_is_not_in_plain_view():
    (chair,) = chair_map(2.2).objects()
    near = replace(chair, id="chair-2", position_m=np.array([1.3, 0.0]))
    far = replace(chair, id="chair-2", position_m=np.array([3.5, 0.0]))
    (hiding,) = expected_boxes([near], CAMERA, SE2())
    box = Detections(hiding[None], np.array([0.9]), np.array([0]), ("chair",))

    def is_plain(objects, detections):
        boxes = expected_boxes(objects, CAMERA, SE2())
        return in_plain_view(objects, boxes, CAMERA, SE2(), detections, ViewRule()).tolist()[0]

    assert is_plain([chair, far], NOTHING)
    assert not is_plain([chair, near], NOTHING)
    assert not is_plain([chair], box)


def looks_from(count):
    """Poses that differ enough for each to be a look, with a plain view of the chair."""
    return [SE2(0.3 + 0.2 * (number % 2), 0.0, 0.0) for number in range(count)]


def test_confidence_falls_look_by_look_until_the_object_leaves_and_its_id_is_not_given_again():
    floor_map, forgetter = chair_map(), Forgetter(CAMERA)
    confidences, real = [], floor_map.objects()[0].confidence
    for pose in looks_from(12):
        forgetter.observe(floor_map, NOTHING, pose, [])
        confidences += [item.confidence for item in floor_map.objects()]
    assert floor_map.objects() == []
    assert 4 < len(confidences) <= 10  # one miss is no reason
    assert confidences[0] == pytest.approx(real)
    assert all(after < before for before, after in pairwise(confidences))
    assert np.array(confidences[1:]) / real == pytest.approx([0.8, 0.6, 0.4, 0.2])  # five looks miss what is gone
    found = sightings_of(look([("chair", 2.0, 0.0)], SE2(), np.random.default_rng(2), 1.0)[0], CAMERA, FloorRule())
    assert floor_map.update([PlacedSighting(found[0], SE2(), np.zeros((3, 3)))]) == ["chair-2"]


def test_a_hit_restores_and_a_box_of_its_like_in_its_place_is_no_miss():
    floor_map, forgetter = chair_map(), Forgetter(CAMERA)
    for pose in looks_from(4):
        forgetter.observe(floor_map, NOTHING, pose, [])
    doubted = floor_map.objects()[0].confidence
    assert doubted < 0.9
    forgetter.observe(floor_map, NOTHING, looks_from(4)[-1], ["chair-1"])
    forgetter.observe(floor_map, NOTHING, SE2(), ["chair-1"])
    restored = floor_map.objects()[0].confidence
    assert restored > doubted
    for pose in looks_from(30):
        box = expected_boxes(floor_map.objects(), CAMERA, pose)
        there = Detections(box, np.array([0.9]), np.array([0]), ("chair",))
        forgetter.observe(floor_map, there, pose, ["chair-7"])
    assert floor_map.objects()[0].confidence == restored
