"""Maps of many robots become one: it depends on the latest maps alone, and nothing counts twice."""

from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.rooms import furnished, mapped, somewhere

from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.objects.place import MergeBudget, RobotMap, merge_place


def robot_map(objects, zones=()):
    text = repr([(item.id, item.position_m.tolist(), item.count) for item in objects])
    return RobotMap(sha256(text.encode()).hexdigest(), tuple(objects), tuple(zones))


def drives(seed, robots, things=14):
    """Maps of one room by robots that each miss some of it, and the poses that they began at."""
    random = np.random.default_rng(seed)
    room = furnished(random, things)
    poses = {f"robot{k}": somewhere(random) for k in range(robots)}
    return room, poses, {
        name: robot_map(mapped(room, pose, random, sigma_m=0.05, missed=0.15)) for name, pose in poses.items()
    }  # fmt: skip


def plain(place):
    objects = [(item.id, item.position_m.tolist(), item.covariance_m2.tolist(), item.count) for item in place.objects]
    return objects, {name: (member.pose_place_map, member.reason) for name, member in place.members.items()}


def test_eight_robots_make_the_room_in_the_first_ones_frame():
    room, poses, maps = drives(3, 8)
    place = merge_place(maps)
    assert all(member.pose_place_map is not None for member in place.members.values())
    for name, member in place.members.items():
        expected = poses["robot0"].inverse() @ poses[name]
        assert member.pose_place_map is not None
        exact = 1e-9 if name == "robot0" else 0.15
        assert member.pose_place_map.vector() == pytest.approx(expected.vector(), abs=exact)
    assert len(place.objects) == len(room)
    truth = mapped(room, poses["robot0"])
    for item in truth:
        nearest = min(np.linalg.norm(item.position_m - other.position_m) for other in place.objects)
        assert nearest < 0.1


@given(st.integers(0, 10_000), st.permutations(range(5)))
@settings(max_examples=12, deadline=None)
def test_the_order_in_which_maps_come_changes_nothing(seed, order):
    _, _, maps = drives(seed, 5, things=12)
    names = sorted(maps)
    known = {}
    arriving = {}
    for row in order:  # each with what the robots before it made known, as a keeper has it
        arriving[names[row]] = maps[names[row]]
        place = merge_place(arriving, known=known)
    assert plain(place) == plain(merge_place(maps))


@given(st.integers(0, 10_000))
@settings(max_examples=12, deadline=None)
def test_nothing_counts_twice_when_a_robot_is_back(seed):
    """Every sighting of the maps that fit is in the merged map once, whatever came before the latest maps."""
    random = np.random.default_rng(seed)
    _, _, maps = drives(seed, 4)
    known = {}
    merge_place(maps, known=known)
    longer = [replace(item, count=item.count + int(random.integers(1, 9))) for item in maps["robot1"].objects]
    maps["robot1"] = robot_map(longer)
    place = merge_place(maps, known=known)
    fitting = [name for name, member in place.members.items() if member.pose_place_map is not None]
    assert sum(item.count for item in place.objects) == sum(o.count for name in fitting for o in maps[name].objects)
    assert plain(place) == plain(merge_place(maps))


def test_a_map_of_somewhere_else_stays_apart_until_it_fits():
    _, _, maps = drives(5, 3)
    elsewhere = robot_map(mapped(furnished(np.random.default_rng(99), 40, size_m=(20.0, 20.0))))
    lone = robot_map(mapped([("bed", 0.0, 0.0)]))
    place = merge_place(maps | {"a-stranger": elsewhere, "b-fresh": lone})
    assert place.members["a-stranger"].pose_place_map is None
    assert "explains" in place.members["a-stranger"].reason
    assert "at least 4 are needed" in place.members["b-fresh"].reason
    own = place.members["robot0"].pose_place_map  # the richest map is alone, so it is not the place
    assert own is not None
    assert own.vector() == pytest.approx(np.zeros(3), abs=1e-9)
    assert plain(place)[0] == plain(merge_place(maps))[0]
    back = merge_place(maps | {"a-stranger": maps["robot2"], "b-fresh": lone})
    assert back.members["a-stranger"].pose_place_map is not None


def test_a_robot_that_fits_only_onto_what_another_adds():
    random = np.random.default_rng(8)
    hall = furnished(random, 40, size_m=(16.0, 6.0))
    left, middle, right = ([item for item in hall if low <= item[1] < high] for low, high in ((0, 7), (3, 13), (9, 16)))
    maps = {
        name: robot_map(mapped(part, somewhere(random)))
        for name, part in zip("abc", (left, middle, right), strict=True)
    }
    place = merge_place(maps)
    assert [member.reason for member in place.members.values()] == ["", "", ""]
    assert len(place.objects) == len({*left, *middle, *right})
    assert merge_place({"a": maps["a"], "c": maps["c"]}).members["a"].reason == ""
    assert merge_place({"a": maps["a"], "c": maps["c"]}).members["c"].pose_place_map is None


def test_a_map_made_before_gives_the_frame():
    _, poses, maps = drives(11, 3)
    before = maps.pop("robot2")
    place = merge_place(maps, before)
    assert sorted(place.members) == ["robot0", "robot1"]
    for name, member in place.members.items():
        expected = poses["robot2"].inverse() @ poses[name]
        assert member.pose_place_map is not None
        assert member.pose_place_map.vector() == pytest.approx(expected.vector(), abs=0.2)
    stranger = merge_place({"a": robot_map(mapped([("bed", 0.0, 0.0)]))}, before)
    assert plain(stranger)[0] == plain(merge_place({}, before))[0]


def test_zones_come_along():
    _, poses, maps = drives(12, 2)
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    maps["robot1"] = replace(maps["robot1"], zones=(Zone("zone-1", "charging", corners),))
    (zone,) = merge_place(maps).annotations.zones
    expected = (poses["robot0"].inverse() @ poses["robot1"]).apply(np.array(corners))
    assert zone.name == "charging"
    assert np.array(zone.corners_m) == pytest.approx(expected, abs=0.2)


def test_nobody_has_mapped_anything():
    assert merge_place({}).objects == ()
    place = merge_place({"a": robot_map([]), "b": robot_map([])})
    assert place.objects == ()
    assert "share 0 objects" in place.members["b"].reason


def test_work_is_bounded(monkeypatch):
    monkeypatch.setattr("edgemap.geometry.objects.place.UNITS_OF_WORK", 1)
    _, _, maps = drives(3, 2)
    reasons = {member.reason for member in merge_place(maps).members.values()}
    assert any("too many motions" in reason for reason in reasons)


def test_a_crowd_that_comes_at_once_is_merged_in_a_few_turns_and_a_changed_map_in_one():
    """Forty robots cost more than one merge may; what is found stays, and each pays for itself."""
    room, poses, maps = drives(5, 40, things=20)
    known, budget = {}, MergeBudget(arrived={name: number for number, name in enumerate(maps)})

    def joined():
        members = merge_place(maps, None, known, budget).members.values()
        return sum(member.pose_place_map is not None for member in members)

    counts = [joined() for _ in range(4)]
    assert counts[0] < 40 == counts[-1]
    random = np.random.default_rng(9)
    for number, name in enumerate(list(maps)[::2]):  # half of them have seen a little more
        maps[name] = robot_map(mapped(room, poses[name], random, sigma_m=0.05, missed=0.1))
        budget.arrived[name] = 100 + number
    assert joined() == 40
