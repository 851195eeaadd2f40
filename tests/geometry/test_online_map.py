"""The online map is the one that its batch version makes of all frames at once, on drives with all that goes wrong."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2
from support.batch import batch_objects

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.map_object import id_order
from edgemap.geometry.objects.pool_index import PoolIndex, distances
from edgemap.geometry.observations.sighting import FloorRule
from edgemap.geometry.slam.keyframes import TrajectoryCorrection

# What is joined to stay bounded, no later frame parts again; what is due later is not associated yet.
UNBOUNDED = AssociationRule(maximum_pools=10**6, grown=1.0)


def agree(online, batch):
    """The same count, and centres one to one by label within 0.10 m."""
    assert len(online) == len(batch)
    distance = np.array(
        [[np.linalg.norm(a.position_m - b.position_m) if a.label == b.label else 9.0 for b in batch] for a in online]
    ).reshape(len(online), len(batch))
    rows, columns = linear_sum_assignment(distance)
    assert distance[rows, columns].max(initial=0.0) < 0.10


def associated(floor_map):
    """The map after the frames without sightings that its budget needs."""
    while floor_map._pending:
        floor_map.update([])
    return floor_map


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
    online, frames = FloorMap(), []
    for frame in range(40):
        sigma_m = rng.uniform(0.04, 0.12)
        seen = [(label, spot + rng.normal(0, sigma_m, 2)) for label, spot in places if rng.random() < 0.5]
        frames.append([placed(label, *spot, frame, sigma_m=sigma_m) for label, spot in seen])
        online.update(frames[-1])
    agree(online.objects(), batch_objects(frames))
    assert len(online.objects()) == len(places)
    for label, spot in places:
        near = [np.linalg.norm(item.position_m - spot) for item in online.objects() if item.label == label]
        assert min(near) < 0.1


@given(st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_the_map_is_that_of_its_batch_version_at_any_time(placed_, seed):
    online, frames = FloorMap(UNBOUNDED), []
    for sightings in drive(placed_, seed):
        online.update(sightings)
        frames.append(sightings)
        if len(frames) % 20 == 0:
            associated(online)
            agree(online.objects(), batch_objects(frames))


@given(st.integers(0, 10**6))
@settings(max_examples=8, deadline=None)
def test_the_order_of_the_frames_makes_no_other_objects(placed_, seed):
    frames = list(drive(placed_, seed))
    forward, shuffled = FloorMap(UNBOUNDED), FloorMap(UNBOUNDED)
    for sightings in frames:
        forward.update(sightings)
    for row in np.random.default_rng(seed).permutation(len(frames)):
        shuffled.update(frames[row])
    agree(associated(forward).objects(), associated(shuffled).objects())


@given(st.integers(0, 10**6))
@settings(max_examples=8, deadline=None)
def test_every_id_ever_told_is_an_object_or_says_what_it_became(placed_, seed):
    floor_map, told, counts = FloorMap(), set(), 0
    for sightings in drive(placed_, seed):
        ids = floor_map.update(sightings)
        assert [id_order(identity)[0] for identity in ids] == [placed.label for placed in sightings]
        assert len(set(ids)) == len(ids)  # never two boxes of one frame
        told.update(ids)
        counts += len(ids)
    for identity in told:
        assert (identity in floor_map._objects) != (identity in floor_map.merged)
    assert set(floor_map.merged.values()) <= set(floor_map._objects)
    assert sum(pool.sums.count for item in floor_map._objects.values() for pool in item.pools) == counts


def test_a_thing_that_turns_out_to_be_two_keeps_its_id_at_the_larger_part(placed):
    """From afar two chairs look like one; near by, they are seen side by side."""
    chairs = FloorMap()
    for frame in range(4):
        assert chairs.update([placed("chair", 2.1, 0.1, frame, sigma_m=0.4)]) == ["chair-1"]
    for frame in range(4, 8):
        chairs.update([placed("chair", 2.0, 0.0, frame, sigma_m=0.05)])
    for frame in range(8, 12):
        near = [placed("chair", 2.0, 0.0, frame, sigma_m=0.05), placed("chair", 2.6, 0.0, frame, sigma_m=0.05)]
        assert chairs.update(near) == ["chair-1", "chair-2"]
    first, second = chairs.objects()
    assert (first.id, first.position_m[0]) == ("chair-1", pytest.approx(2.0, abs=0.02))
    assert (second.id, second.position_m[0]) == ("chair-2", pytest.approx(2.6, abs=0.02))


def correction(*moves, sigma_m=0.0):
    """From stamp 0 on everything moves by the first (2,), from 0.5 s on by the next, and so on."""
    count = len(moves)
    covariances = np.tile(np.diag([sigma_m**2, 4.0 * sigma_m**2, 0.0]), (count, 1, 1))
    stamps = np.arange(count, dtype=np.float64) / 2.0
    return TrajectoryCorrection(stamps, np.column_stack([moves, np.zeros(count)]), np.zeros((count, 3)), covariances)


def test_objects_that_move_keep_their_ids_and_what_comes_to_one_place_merges(placed):
    chairs = FloorMap()
    for frame in range(5):
        chairs.update([placed("chair", 2.0, 0.0, frame), placed("chair", 5.0, 0.0, frame)])
    for frame in range(5, 10):
        chairs.update([placed("chair", 3.1, 0.9, frame)])
    assert len(chairs.objects()) == 3
    chairs.moved(correction([0.5, 0.5], [-0.6, -0.4], sigma_m=0.1))
    first, second = chairs.objects()
    assert (first.id, second.id, chairs.merged) == ("chair-1", "chair-2", {"chair-3": "chair-1"})
    assert first.position_m == pytest.approx([2.5, 0.5])
    assert second.position_m == pytest.approx([5.5, 0.5])
    assert (first.count, first.covariance_m2[1, 1] - first.covariance_m2[0, 0]) == (10, pytest.approx(0.03))


def test_an_object_without_a_track_moves_with_the_pose_that_saw_it(placed):
    """Four sightings make an object, five a landmark of the pose graph; a visit may leave no more than three."""
    chairs = FloorMap()
    for frame in range(4):
        chairs.update([placed("chair", 2.0, 0.0, frame, track=-1)])
    chairs.moved(correction([1.5, -0.2]))
    assert chairs.objects()[0].position_m == pytest.approx([3.5, -0.2])


def test_two_objects_taken_for_one_part_when_they_turn_out_to_stand_apart(placed):
    chairs = FloorMap()
    for frame in range(5):
        chairs.update([placed("chair", 2.0, 0.0, frame, track=0)])
    for frame in range(5, 9):  # its twin, seen from a pose that had drifted
        chairs.update([placed("chair", 2.05, 0.1, frame, track=1)])
    assert [item.count for item in chairs.objects()] == [9]
    chairs.moved(correction([0.0, 0.0], [0.9, 0.0]))
    first, second = chairs.objects()
    assert (first.id, first.count, second.count) == ("chair-1", 5, 4)
    assert second.position_m == pytest.approx([2.95, 0.1])


@given(st.integers(0, 10**6), st.integers(3, 8))
@settings(max_examples=8, deadline=None)
def test_pools_stay_bounded_and_no_sighting_is_lost(placed_, seed, maximum):
    floor_map, counts = FloorMap(AssociationRule(maximum_pools=maximum)), 0
    for number, sightings in enumerate(drive(placed_, seed, frames=90)):
        floor_map.update(sightings)
        counts += len(sightings)
        if number % 20 == 19:
            shift = np.random.default_rng(number).normal(0.0, 0.1, 2)
            floor_map.moved(correction(shift, -shift))
    for item in floor_map._objects.values():
        own = [pool for pool in item.pools if not all(other is pool or pool.is_apart(other) for other in item.pools)]
        assert len(own) <= maximum
    assert sum(pool.sums.count for item in floor_map._objects.values() for pool in item.pools) == counts
    assert sum(len(index) for index in floor_map._pools.values()) == len(floor_map._owner)


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


def test_sightings_that_are_half_sure_make_an_object_in_twice_as_many(placed):
    half = FloorMap()
    for frame in range(8):
        item = placed("chair", 2.0, 0.0, frame)
        assert half.objects() == []
        half.update([replace(item, sighting=replace(item.sighting, weight=0.5))])
    assert len(half.objects()) == 1


@pytest.mark.parametrize(("score", "weight"), [(0.65, 0.0), (0.75, 0.25), (0.8, 0.5), (0.85, 0.75), (0.95, 1.0)])
def test_how_much_a_score_counts(score, weight):
    assert FloorRule(full_weight_score=0.8).weight(score) == pytest.approx(weight)
    assert FloorRule().weight(score) == 1.0


def test_what_is_seen_again_and_again_is_associated_ever_less_often(placed, monkeypatch):
    """Two chairs 400 times: as in a map that associates them every time, with a tenth of the work."""
    counts = []
    agglomerated = PoolIndex.agglomerated
    monkeypatch.setattr(PoolIndex, "agglomerated", lambda *args: counts.append(1) or agglomerated(*args))
    maps, done = [], []
    for grown in (1.0, 1.25):
        floor_map, rng = FloorMap(AssociationRule(grown=grown)), np.random.default_rng(0)
        for frame in range(400):
            here = rng.normal([[2.0, 0.5], [3.0, -1.0]], 0.03)
            floor_map.update([placed("chair", *spot, frame) for spot in here])
        maps.append(floor_map.objects())
        done.append(len(counts) - sum(done))
    agree(*maps)
    assert done[1] < 0.2 * done[0]


def test_the_gate_holds_999_of_1000_places_of_one_object():
    assert AssociationRule().gate == pytest.approx(chi2.ppf(0.999, df=2), abs=0.01)


def test_places_of_one_landmark_are_no_distance_apart_the_first_landmark_too():
    """1 m apart with sigmas of 0.01 m; landmarks count from 0, and -1 is none."""
    place = np.array([[0.0, 1.0], [0.0, 0.0], [1e-4, 1e-4], [0.0, 0.0], [1e-4, 1e-4], [0.0, 0.0]])
    for landmark, apart in ((0.0, 0.0), (1.0, 0.0), (-1.0, np.inf)):
        both = np.vstack([place, [landmark, landmark]])
        assert distances(both[:, :1], both[:, 1:], AssociationRule())[0, 0] == apart
