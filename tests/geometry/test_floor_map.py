"""Which sightings become one object of the map, frame by frame; the paper's clusters; the map's file."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage

from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import id_order
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.pose_graph import GraphRule
from edgemap.runtime.step.map_file import load_map, map_document, read_map, save_map, saved_text


def drive(placed, seed, frames=60):
    """Objects at random places, some near others of their class, sighted now and then with errors that grow with
    distance and time, sometimes under another label, twice, or where nothing stands."""
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
        own = [placed(label, *spot, frame, sigma_m=sigma_m, score=rng.uniform(0.3, 0.95)) for label, spot in here]
        yield [replace(sighting, pose_covariance=pose) for sighting in own]


@given(st.integers(0, 10**6))
@settings(max_examples=8)
def test_every_id_ever_told_is_an_object_or_says_what_it_became(placed_, seed):
    floor_map, reported, counts = FloorMap(), set(), 0
    for sightings in drive(placed_, seed):
        ids = floor_map.update(sightings)
        assert [id_order(identity)[0] for identity in ids] == [placed.label for placed in sightings]
        assert len(set(ids)) == len(ids)  # never two boxes of one frame
        reported.update(ids)
        counts += len(ids)
    for identity in reported:
        assert (identity in floor_map._objects) != (identity in floor_map.merged)
    assert set(floor_map.merged.values()) <= floor_map._objects.keys()
    assert sum(one.sums.count for one in floor_map.graph.landmarks.values()) == counts


def visited(chairs, placed, x_m, y_m, frames, by_m=4.0):
    """A chair, in the first pose's frame, is seen from where the robot stands, which then moves on: a visit ends."""
    graph = chairs.graph
    for frame in frames:
        if frame == frames[0] and len(graph.trajectory):
            graph.trajectory.advance(SE2(by_m), np.eye(3) * 1e-4, frame / 10)
        pose = graph.trajectory.pose if len(graph.trajectory) else SE2()
        at = pose.inverse().apply([x_m, y_m])
        sighting = placed("chair", *at, frame).sighting
        chairs.update([PlacedSighting(sighting, pose, np.zeros((3, 3)))])


def moved(chairs, *moves):
    """Each keyframe moves by (2,)."""
    trajectory = chairs.graph.trajectory
    poses = trajectory.poses + np.column_stack([moves, np.zeros(len(moves))])
    trajectory.set_poses(poses, trajectory.covariances)
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
    chairs = FloorMap().continued([saved])
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
    assert len(chairs.graph.landmarks) <= 4
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
            frames = [frame for frame, one in enumerate(ids) if chairs.merged.get(one, one) == item.id]
            assert item.id == min((ids[frame] for frame in frames), key=id_order)  # clusters that grow together
            assert (item.first_seen_s, item.last_seen_s) == pytest.approx((frames[0] / 10, frames[-1] / 10))


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
    assert len(chairs.graph.landmarks) <= chairs.graph.rule.maximum + 1
    assert [item.label for item in chairs.objects()] == ["chair"]


def test_confidence_is_the_probability_that_such_an_object_is_real(placed):
    """The odds of the mean score after 4 full sightings of 4 pictures each, and in proportion to them: those of a chair
    of 0.9 are 9 / 4 after 4 frames and 9 * 30 / 16 after 30, those of one of 0.5 are 1 / 4 and 30 / 16."""
    for score, after_4, after_30 in ((0.9, 9.0 / 13.0, 270.0 / 286.0), (0.5, 1.0 / 5.0, 30.0 / 46.0)):
        chairs, reported = FloorMap(), {}
        for frame in range(30):
            chairs.update([placed("chair", 2.0, 0.0, frame, score=score)])
            reported |= {item.count: item.confidence for item in chairs.objects()}
        assert (reported[4], reported[30]) == pytest.approx((after_4, after_30), abs=1e-3)
        assert list(reported.values()) == sorted(reported.values())


def test_what_an_earlier_map_is_sure_of_is_not_doubted_when_seen_again(placed):
    first = FloorMap()
    for frame in range(30):
        first.update([placed("chair", 2.0, 0.0, frame)])
    (saved,) = first.objects()
    again = FloorMap().continued([saved])
    again.update([placed("chair", 2.0, 0.0, 40, score=0.4)])
    (item,) = again.objects()
    assert (item.count, item.confidence) == (31, pytest.approx(saved.confidence))


@pytest.fixture
def objects(placed):
    chairs = FloorMap()
    for frame in range(8):
        chairs.update([placed("chair", 2.0, 0.5, frame), placed("couch", 3.0, -1.0, frame)])
    return chairs.objects()


def test_a_covariance_that_rounds_to_two_values_reads_back(objects):
    odd = np.array([[29.0, 15.02238263051], [15.02238263049, 110.0]])  # the fuzz of edits made such a one
    read, _ = read_map(saved_text(map_document([replace(objects[0], covariance_m2=odd)])).encode(), "map")
    np.testing.assert_allclose(read[0].covariance_m2, odd)


def test_a_failed_save_keeps_the_old_map(tmp_path, objects, monkeypatch):
    save_map(tmp_path / "map.json", objects)
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(MapError, match="No space left"):
        save_map(tmp_path / "map.json", [])
    monkeypatch.undo()
    assert len(load_map(tmp_path)) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["map.json"]
