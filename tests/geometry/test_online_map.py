"""Which sightings become one object of the map, frame by frame, on drives with all that goes wrong."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.map_object import id_order
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.se2 import SE2


def drive(placed, seed, frames=60):
    """Things anywhere, some close to their like, seen off and on with errors that grow with distance and time, now and
    then under another label, twice, or where nothing stands."""
    rng = np.random.default_rng(seed)
    places = [(str(rng.choice(["chair", "couch", "vase"])), rng.uniform(-2.5, 2.5, 2)) for _ in range(9)]
    drift = rng.normal(0, 0.004, 2)
    for frame in range(frames):
        sigma_m = rng.uniform(0.04, 0.3)
        pose = np.diag([(0.004 * frame) ** 2, (0.004 * frame) ** 2, 0.0])
        seen = [(label, spot) for label, spot in places if rng.random() < 0.4]
        seen += [(label, spot) for label, spot in seen if rng.random() < 0.05]
        seen = [("chair" if rng.random() < 0.05 else label, spot) for label, spot in seen]
        seen += [("vase", rng.uniform(-3, 3, 2))] if rng.random() < 0.2 else []
        here = [(label, spot + drift * frame + rng.normal(0, sigma_m, 2)) for label, spot in seen]
        yield [
            replace(placed(label, *spot, frame, sigma_m=sigma_m, score=rng.uniform(0.3, 0.95)), pose_covariance=pose)
            for label, spot in here
        ]


@pytest.mark.parametrize("seed", range(15))
def test_things_apart_from_their_like_are_found_one_by_one(placed, seed):
    """Up to eight objects at least 0.9 m from their like, seen off and on from changing distances."""
    rng = np.random.default_rng(seed)
    places = []
    for _ in range(8):
        label, spot = str(rng.choice(["chair", "couch"])), rng.uniform(-3, 3, 2)
        if all(np.linalg.norm(spot - at) >= (0.9 if other == "chair" == label else 1.6) for other, at in places):
            places.append((label, spot))
    online = FloorMap()
    for frame in range(40):
        sigma_m = rng.uniform(0.04, 0.12)
        seen = [(label, spot + rng.normal(0, sigma_m, 2)) for label, spot in places if rng.random() < 0.5]
        online.update([placed(label, *spot, frame, sigma_m=sigma_m) for label, spot in seen])
    assert len(online.objects()) == len(places)
    for label, spot in places:
        near = [np.linalg.norm(item.position_m - spot) for item in online.objects() if item.label == label]
        assert min(near) < 0.1


@given(st.integers(0, 10**6))
@settings(max_examples=8)
def test_every_id_ever_told_is_an_object_or_says_what_it_became(placed_, seed):
    floor_map, told, counts = FloorMap(), set(), 0
    for sightings in drive(placed_, seed):
        ids = floor_map.update(sightings)
        assert [id_order(identity)[0] for identity in ids] == [placed.label for placed in sightings]
        assert len(set(ids)) == len(ids)  # never two boxes of one frame
        told.update(ids)
        counts += len(ids)
    for identity in told:
        assert (identity in floor_map.ids) != (identity in floor_map.merged)
    assert set(floor_map.merged.values()) <= floor_map.ids
    assert sum(one.sums.count for one in floor_map.graph.landmarks.all.values()) == counts


def visited(chairs, placed, x_m, y_m, frames, by_m=4.0):
    """A chair, in the first pose's frame, is seen from where the robot stands, which then moves on: a visit ends."""
    graph = chairs.graph
    for frame in frames:
        if frame == frames[0] and graph.trajectory.poses:
            graph.advance(SE2(by_m), np.eye(3) * 1e-4, frame / 10)
        pose = graph.trajectory.pose if graph.trajectory.poses else SE2()
        at = pose.inverse().apply([x_m, y_m])
        sighting = placed("chair", *at, frame).sighting
        chairs.update([sighting.placed(pose, np.zeros((3, 3)))])


def moved(chairs, *moves):
    """Each keyframe moves by (2,)."""
    trajectory = chairs.graph.trajectory
    poses = trajectory.vectors() + np.column_stack([moves, np.zeros(len(moves))])
    trajectory.set_poses(poses, np.array(trajectory.covariances), 99.0)
    chairs.graph.place(list(chairs.graph.landmarks.all.values()))
    chairs.moved()


def test_objects_that_move_keep_their_ids_and_what_comes_to_one_place_merges(placed):
    chairs = FloorMap()
    visited(chairs, placed, 2.0, 0.0, range(5))
    visited(chairs, placed, 4.5, 0.9, range(5, 10))
    assert [item.id for item in chairs.objects()] == ["chair-1", "chair-2"]
    moved(chairs, [0.5, 0.5], [-2.0, -0.4])
    (only,) = chairs.objects()
    assert (only.id, only.count, chairs.merged) == ("chair-1", 10, {"chair-2": "chair-1"})
    assert only.position_m == pytest.approx([2.5, 0.5])


def test_a_saved_object_keeps_its_id_when_what_was_taken_for_it_proves_another(placed):
    before = FloorMap()
    visited(before, placed, 2.0, 0.0, range(5))
    (saved,) = before.objects()
    chairs = FloorMap.continued([saved])
    visited(chairs, placed, 2.0, 0.0, range(10, 30))
    assert [item.id for item in chairs.objects()] == ["chair-1"]
    moved(chairs, [3.0, 0.0])
    assert {item.id: item.position_m[0] for item in chairs.objects()} == pytest.approx({"chair-1": 2.0, "chair-2": 5.0})


def test_many_visits_are_joined_and_no_sighting_is_lost(placed):
    chairs = FloorMap()
    for visit in range(12):
        visited(chairs, placed, 2.0, 0.02 * (visit % 3), range(5 * visit, 5 * visit + 5), (-1.0) ** visit * 4.0)
        chairs.bound()
    (only,) = chairs.objects()
    assert only.count == 60
    assert len(chairs.graph.landmarks.all) <= 4
    assert only.position_m == pytest.approx([2.0, 0.02], abs=0.02)


def test_an_object_named_twice_is_one_with_a_posterior(placed):
    """Thirty times a couch, three times a suitcase: a couch, and the suitcase is not beside it."""
    home = FloorMap()
    for frame in range(33):
        home.update([placed("suitcase" if frame % 11 == 5 else "couch", 2.0, 0.0, frame)])
    (couch,) = home.objects()
    assert couch.label == "couch"
    assert couch.labels["couch"] > 0.99
    assert set(couch.labels) == {"couch", "suitcase"}
    assert home.shown_as("suitcase-1") == "couch-1"


def test_sightings_under_two_names_make_one_object_together(placed):
    """Neither of them has the four sightings that an object needs."""
    home = FloorMap()
    for frame in range(5):
        home.update([placed("suitcase" if frame > 2 else "backpack", 2.0, 0.0, frame)])
    (item,) = home.objects()
    assert item.label == "backpack"
    assert 0.5 < item.labels["backpack"] < 0.9


def test_faint_sightings_add_to_an_object_but_make_none(placed):
    faint_map, mixed = FloorMap(), FloorMap()
    for frame in range(12):
        strong, faint = placed("chair", 2.0, 0.0, frame), placed("chair", 2.0, 0.0, frame, score=0.6)
        faint = replace(faint, sighting=replace(faint.sighting, weight=0.0))
        faint_map.update([faint])
        mixed.update([strong if frame < 4 else faint])
    assert faint_map.objects() == []
    (chair,) = mixed.objects()
    assert chair.count == 12
