import math

import numpy as np
import pytest
from support.drifting import drifting, integrated, worst_m
from support.drives import round_trip, sighted
from support.rooms import furnished, mapped

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule
from edgemap.geometry.slam.pose_graph import DriveGraph, GraphRule

ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)
TWO_ROUNDS = round_trip(240, turns=2.2)


def driven(room, way, rule=None, graph=None, seed=0, **drift):
    """A graph after a drive, and the poses as they are known at its end."""
    random = np.random.default_rng(seed)
    graph = graph or DriveGraph(rule)
    told, past = [], None
    for index, motion in enumerate(drifting(way, seed, **drift)):
        if len(graph.way) == 0:
            graph.way.begin(SE2(), np.zeros((3, 3)), 0.0)
        elif graph.advance(motion.motion, motion.covariance, index / 10) and (found := graph.revisit()):
            past = found.past if past is None else past.then(found.past)
        told.append(graph.way.pose.vector())
        graph.look(sighted(room, way[index], index, random))
    if past is not None:
        told = past.poses(np.arange(len(told)) / 10, told)
    return graph, [SE2(*pose) for pose in told]


@pytest.mark.parametrize("seed", range(4))
def test_things_seen_again_put_the_whole_way_right(seed):
    graph, poses = driven(ROOM, TWO_ROUNDS, seed=seed)
    alone = worst_m(integrated(drifting(TWO_ROUNDS, seed)), TWO_ROUNDS)
    assert graph.links >= 4
    assert worst_m(poses, TWO_ROUNDS) < 0.3 * alone


def test_what_is_linked_is_one_thing():
    graph, _ = driven(ROOM, TWO_ROUNDS)
    start = TWO_ROUNDS[0].inverse()
    for tracks in graph.groups().values():
        assert len({track.label for track in tracks}) == 1
        if len(tracks) > 1:
            distances = [
                np.linalg.norm(tracks[0].position_m - start.apply([x, y]))
                for label, x, y in ROOM
                if label == tracks[0].label
            ]
            assert min(distances) < 0.4  # nearer than half the way to any neighbour


def test_a_way_that_never_returns_is_left_as_it_is():
    corridor = [("chair", 1.5 * k, 1.0) for k in range(14)] + [("chair", 1.5 * k + 0.4, -1.0) for k in range(14)]
    ahead = [SE2(0.1 * k, 0.0, 0.0) for k in range(180)]  # 28 twins, none seen twice
    graph, poses = driven(corridor, ahead)
    assert graph.links == 0
    alone = integrated(drifting(ahead))
    np.testing.assert_allclose([pose.vector() for pose in poses], [pose.vector() for pose in alone], atol=1e-9)


def test_another_room_with_the_same_furniture_is_not_the_first():
    there = [(label, x + 9.0, y) for label, x, y in ROOM]
    lone = [SE2(5.2 + 0.1 * k, 3.0, 0.0) for k in range(90)]
    second = [SE2(pose.x_m + 9.0, pose.y_m, pose.yaw_rad) for pose in round_trip(110)]
    way = [*round_trip(110), *lone, *second]
    _, poses = driven([*ROOM, *there], way, yaw_share=0.01)
    assert worst_m(poses, way) < 1.3 * worst_m(integrated(drifting(way, yaw_share=0.01)), way)


def test_one_thing_alone_in_a_room_corrects_nothing():
    graph, _ = driven([("chair", 4.0, 4.8)], TWO_ROUNDS)
    assert sum(len(tracks) for tracks in graph.groups().values()) >= 2  # it was seen, and seen again
    assert graph.links == 0


def test_the_same_frames_give_the_same_way_to_the_bit():
    first, second = (driven(ROOM, TWO_ROUNDS)[1] for _ in range(2))
    assert [pose.vector().tolist() for pose in first] == [pose.vector().tolist() for pose in second]


def test_a_long_drive_stays_small_and_right():
    rule = GraphRule(way=KeyframeRule(most=40), most=25)
    way = round_trip(500, turns=5.0)
    graph, poses = driven(ROOM, way, rule)
    assert len(graph.way) <= 41
    assert len(graph.groups()) < 60
    assert worst_m(poses, way) < 0.4 * worst_m(integrated(drifting(way)), way)


def test_a_saved_maps_things_say_where_the_robot_is():
    # It starts where a person says, 0.2 m and 4 degrees off; the saved map is in the room's own frame.
    way = round_trip(120)
    consensus = SE2(way[0].x_m + 0.2, way[0].y_m - 0.1, way[0].yaw_rad + math.radians(4))
    graph = DriveGraph()
    graph.remember(mapped(ROOM, told_sigma_m=0.08))
    graph.way.begin(consensus, np.diag([0.03, 0.03, 0.005]), 0.0)
    random = np.random.default_rng(1)
    for index, motion in enumerate(drifting(way, yaw_share=0.02)):
        if index and graph.advance(motion.motion, motion.covariance, index / 10):
            graph.revisit()
        graph.look(sighted(ROOM, way[index], index, random))
    off = way[-1].inverse() @ graph.way.pose
    assert math.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.yaw_rad) < math.radians(2.5)


def test_what_was_seen_of_a_thing_moves_by_what_the_way_there_was_off():
    random, graph, moved = np.random.default_rng(3), DriveGraph(), None
    off: dict[int, list[np.ndarray]] = {}
    start = TWO_ROUNDS[0].inverse()
    for index, motion in enumerate(drifting(TWO_ROUNDS)):
        if index == 0:
            graph.way.begin(SE2(), np.zeros((3, 3)), 0.0)
        elif graph.advance(motion.motion, motion.covariance, index / 10) and (moved := graph.revisit()):
            break
        seen = sighted(ROOM, TWO_ROUNDS[index], index, random, sigma_m=0.001)
        for thing, sighting in zip(graph.things(graph.look(seen)), seen, strict=True):
            off.setdefault(thing, []).append(graph.way.pose.apply(sighting.position_base_m))
    assert moved is not None
    better = 0
    for thing, move in moved.moves.items():
        label = next(track.label for track in graph.tracker.tracks.values() if track.number == thing)
        places = [start.apply([x, y]) for kind, x, y in ROOM if kind == label]
        before = np.mean(off[thing], axis=0)
        far, now = (min(np.linalg.norm(place - p) for p in places) for place in (before, before + move.by_m))
        better += now < max(0.6 * far, 0.1)
    assert better > 0.8 * len(moved.moves)
    assert any(number != move.part_of for number, move in moved.moves.items())  # one was found again
