from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.slam.pose_graph import GraphRule


def partition(labels):
    numbers = {}
    return [numbers.setdefault(label, len(numbers)) for label in labels]


@settings(max_examples=60)
@given(st.integers(2, 120), st.floats(0.3, 20), st.integers(0, 10**6))
def test_the_papers_clusters_are_scipys_in_any_order(placed_, count, spread, seed):
    random = np.random.default_rng(seed)
    points = random.uniform(-spread, spread, (count, 2))
    expected = partition(fcluster(linkage(points, "single"), 1.0, "distance"))
    for order in (np.arange(count), random.permutation(count)):
        chairs = PaperMap()
        ids = [chairs.update([placed_("chair", x, y, frame)])[0] for frame, (x, y) in enumerate(points[order])]
        by_point = np.empty(count, dtype=object)
        by_point[order] = [chairs.merged.get(identity, identity) for identity in ids]
        assert partition(by_point) == expected
        for item in chairs.objects():
            mine = points[by_point == item.id]
            assert item.count == len(mine)
            assert item.position_m == pytest.approx(mine.mean(axis=0))


CHAIRS = [(2.0, 0.35), (2.0, -0.35), (2.7, 0.35), (2.7, -0.35)]  # 0.7 m apart, round a table


def dining_frames(placed, frames=40, seed=0):
    rng = np.random.default_rng(seed)
    for frame in range(frames):
        visible = [chair for chair in CHAIRS if rng.random() < 0.8]
        yield [placed("chair", x + rng.normal(0, 0.06), y + rng.normal(0, 0.06), frame) for x, y in visible]


@pytest.mark.parametrize("seed", range(5))
def test_ours_keeps_four_dining_chairs_apart(placed, seed):
    chairs = FloorMap()
    for sightings in dining_frames(placed, seed=seed):
        chairs.update(sightings)
    found = chairs.objects()
    assert len(found) == 4
    for x, y in CHAIRS:
        assert min(np.linalg.norm(item.position_m - [x, y]) for item in found) < 0.05


def test_objects_that_turn_out_to_be_one_merge_and_the_older_id_stays(placed):
    chairs = FloorMap()
    for frame in range(6):
        chairs.update([placed("chair", 2.0, 0.0, frame)])
    for frame in range(6, 12):
        chairs.update([placed("chair", 2.98, 0.0, frame)])
    assert {item.id for item in chairs.objects()} == {"chair-1", "chair-2"}
    for frame in range(12, 200):  # what lies between pulls both together
        chairs.update([placed("chair", 2.49, 0.0, frame, sigma_m=0.1)])
        if chairs.merged:
            break
    (one,) = chairs.objects()
    assert one.id == "chair-1"
    assert chairs.merged == {"chair-2": "chair-1"}
    assert one.first_seen_s == 0.0


def test_shared_error_is_a_floor_that_more_sightings_do_not_lower(placed):
    chairs = FloorMap()
    for frame in range(500):
        chairs.update([placed("chair", 2.0, 0.0, frame, sigma_m=0.1, shared_m=0.05)])
    (chair,) = chairs.objects()
    rule = chairs.graph.rule.landmarks
    floor = 0.05**2 + rule.centre_m2(0.5) + rule.view_m**2 + rule.repeated * 0.1**2  # all from one keyframe
    assert floor < chair.covariance_m2[0, 0] < 1.2 * floor


def test_an_uncertain_heading_at_first_sight_moves_an_object_on_a_circle(placed):
    """0.1 rad at (2, 1): 0.1 m against x and 0.2 m along y, together."""
    chairs = FloorMap()
    for frame in range(50):
        sighting = placed("chair", 2.0, 1.0, frame, sigma_m=0.02, shared_m=0.01)
        chairs.update([replace(sighting, pose_covariance=np.diag([0.0, 0.0, 0.1**2]))])
    (chair,) = chairs.objects()
    (xx, xy), (_, yy) = chair.covariance_m2
    assert (xy, yy - xx) == pytest.approx((-0.02, 0.03), abs=2e-3)  # beside what is as wide in every direction


def test_weak_objects_that_are_not_seen_again_are_forgotten(placed):
    chairs = FloorMap(graph=GraphRule(maximum=50))
    for frame in range(600):  # a false box somewhere else in every frame, and one chair that is really there
        real = [placed("chair", 0.0, 0.0, frame)] if frame < 50 else []
        chairs.update([placed("chair", 5.0 + 3.0 * frame, 0.0, frame, score=0.35), *real])
        chairs.bound()
    assert len(chairs.graph.landmarks.all) <= chairs.graph.rule.maximum + 1
    assert [item.label for item in chairs.objects()] == ["chair"]


def test_paper_ids_follow_clusters_that_grow_together(placed):
    chairs = PaperMap()
    chairs.update([placed("chair", 0.0, 0.0, 0)])
    assert chairs.update([placed("chair", 1.8, 0.0, 1)]) == ["chair-2"]
    assert chairs.update([placed("chair", 0.9, 0.0, 2)]) == ["chair-1"]
    (one,) = chairs.objects()
    assert (one.id, one.count, chairs.merged) == ("chair-1", 3, {"chair-2": "chair-1"})
    assert one.position_m == pytest.approx([0.9, 0.0])
    assert (one.first_seen_s, one.last_seen_s) == (0.0, pytest.approx(0.2))


def test_confidence_is_the_probability_that_such_an_object_is_real(placed):
    """The odds of the mean score after 4 full sightings of 4 pictures each, and in proportion to them: those of a chair
    of 0.9 are 9 / 4 after 4 frames and 9 * 30 / 16 after 30, those of one of 0.5 are 1 / 4 and 30 / 16."""
    for score, after_4, after_30 in ((0.9, 9.0 / 13.0, 270.0 / 286.0), (0.5, 1.0 / 5.0, 30.0 / 46.0)):
        chairs, told = FloorMap(), {}
        for frame in range(30):
            chairs.update([placed("chair", 2.0, 0.0, frame, score=score)])
            told |= {item.count: item.confidence for item in chairs.objects()}
        assert (told[4], told[30]) == pytest.approx((after_4, after_30), abs=1e-3)
        assert list(told.values()) == sorted(told.values())


def test_what_an_earlier_map_is_sure_of_is_not_doubted_when_seen_again(placed):
    first = FloorMap()
    for frame in range(30):
        first.update([placed("chair", 2.0, 0.0, frame)])
    (saved,) = first.objects()
    again = FloorMap.continued([saved])
    again.update([placed("chair", 2.0, 0.0, 40, score=0.4)])
    (item,) = again.objects()
    assert (item.count, item.confidence) == (31, pytest.approx(saved.confidence))
