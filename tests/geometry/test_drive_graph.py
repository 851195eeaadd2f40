import numpy as np
import pytest
from support.drifting import drifting, integrated, worst_m
from support.drives import observed, round_trip, sighted
from support.rooms import ROOM

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule
from edgemap.geometry.slam.loop_closure import witnessed
from edgemap.geometry.slam.pose_graph import GraphRule, PoseGraph
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import Mapper


def new_mapper(rule=None):
    """A back end that closes loops, and its graph."""
    mapper = Mapper(config=Config(loop_closure=rule or GraphRule()), closes_loops=True)
    return mapper, mapper.map.graph


def drive_graph(mapper, room, way, random, motions, each=None):
    """Feed a drive; each(index, update, sightings) gets every frame."""
    for index, motion in enumerate(motions):
        sightings = sighted(room, way[index], index, random)
        update = mapper.step(observed(index, sightings, motion))
        if each is not None:
            each(index, update, sightings)


def driven(room, way, rule=None, seed=0, **drift):
    """A graph after a drive, and the poses as they are known at its end."""
    mapper, graph = new_mapper(rule)
    drive_graph(mapper, room, way, np.random.default_rng(seed), drifting(way, seed, **drift))
    return graph, [SE2(*pose) for pose in mapper.trajectory.at(np.arange(len(way)) / 10)]


def test_a_way_that_never_returns_is_left_as_it_is():
    corridor = [("chair", 1.5 * k, 1.0) for k in range(14)] + [("chair", 1.5 * k + 0.4, -1.0) for k in range(14)]
    ahead = [SE2(0.1 * k, 0.0, 0.0) for k in range(180)]  # 28 twins, none seen twice
    graph, poses = driven(corridor, ahead)
    assert graph.links == {}
    alone = integrated(drifting(ahead))
    np.testing.assert_allclose([pose.vector() for pose in poses], [pose.vector() for pose in alone], atol=1e-9)


def test_another_room_with_the_same_furniture_is_not_the_first():
    there = [(label, x + 9.0, y) for label, x, y in ROOM]
    lone = [SE2(5.2 + 0.1 * k, 3.0, 0.0) for k in range(90)]
    second = [SE2(pose.x_m + 9.0, pose.y_m, pose.yaw_rad) for pose in round_trip(110)]
    way = [*round_trip(110), *lone, *second]
    _, poses = driven([*ROOM, *there], way, yaw_share=0.01)
    assert worst_m(poses, way) < 1.3 * worst_m(integrated(drifting(way, yaw_share=0.01)), way)


def test_a_long_drive_stays_small_and_right():
    rule = GraphRule(keyframes=KeyframeRule(maximum=40), maximum=48)  # three visits of each object
    way = round_trip(500, turns=5.0)
    graph, poses = driven(ROOM, way, rule)
    assert len(graph.trajectory) <= 50
    assert len(graph.landmarks) <= 4 * 16  # visits of each object that are kept apart
    assert sum(len(one.keyframes) for one in graph.landmarks.values()) <= 50 * 16
    assert worst_m(poses, way) < 0.4 * worst_m(integrated(drifting(way)), way)


@pytest.mark.parametrize("wrong", [(0, 1), (2, 3)])
def test_a_wrong_link_is_taken_back_and_the_trajectory_with_it(wrong):
    """Two objects declared one after the first round: the next closures find that it does not fit."""
    (mapper, graph), way, linked = new_mapper(), round_trip(360, turns=3.3), []

    def each(index, update, sightings):
        if index == 100:
            likely = [one for one in graph.landmarks.values() if graph.is_likely(one)]
            first, second = (likely[row].number for row in wrong)
            graph.links[second] = first
            linked.append((second, first))

    drive_graph(mapper, ROOM, way, np.random.default_rng(0), drifting(way), each)
    assert linked[0][0] not in graph.links
    poses = [SE2(*pose) for pose in mapper.trajectory.at(np.arange(len(way)) / 10)]
    assert worst_m(poses, way) < 0.3 * worst_m(integrated(drifting(way)), way)


def test_a_first_visit_that_leaves_hands_its_links_to_the_next_one():
    """Two later visits are linked to it: the earlier of the two stands for the object from then on."""
    graph = PoseGraph()
    graph.links = {4: 1, 7: 1, 9: 8}
    assert graph.unlink(1) == 4
    assert graph.links == {7: 4, 9: 8}
    assert [graph.root(number) for number in (4, 7, 9)] == [4, 4, 8]
    assert graph.unlink(9) == 8
    assert graph.unlink(5) == -1
    assert graph.links == {7: 4}


def test_a_link_needs_other_links_of_about_its_own_time():
    """Landmark 3 may be landmark 0. 1 and 2 are one object: seen long before 3, they say nothing of it."""
    graph = PoseGraph()
    for first, last in ((0, 5), (0, 5), (20, 25), (100, 105)):
        graph.begin("chair", 0.5).keyframes = [first, last]
    graph.links = {2: 1}
    assert witnessed(graph, {3: 0}) == {}
    graph.landmarks[2].keyframes = [20, 99]
    assert witnessed(graph, {3: 0}) == {3: 0}


def test_two_visits_that_become_one_take_their_links_and_neighbours_along(placed):
    graph = PoseGraph()
    a, b = graph.observe([placed("chair", 0.0, 0.0, 0), placed("chair", 3.0, 0.0, 0)])
    again, c = graph.observe([placed("chair", 0.0, 0.0, 1), placed("chair", 6.0, 0.0, 1)])
    assert again is a
    assert (a.distinct, b.distinct) == ({b.number, c.number}, {a.number})
    graph.links = {c.number: a.number}
    graph.join(b, c)
    assert graph.links == {b.number: a.number}  # what c was linked to
    assert sorted(graph.landmarks) == [a.number, b.number]
    assert b.sums.count == 2
    assert b.sums.last_seen_s == 0.1
