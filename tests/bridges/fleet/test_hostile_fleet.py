"""One robot among others lies, floods, or breaks the map: the others' map stays, and is served in time."""

import json
import os
import time
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import furnished, mapped, somewhere
from support.waiting import free_port, wait_for

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.edits import Annotations, Zone
from edgemap.geometry.objects.place import (
    TOTAL_UNITS,
    MergeBudget,
    MergeStopped,
    RobotMap,
    balanced,
    merge_place,
)
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.step.map_file import load_map, map_document, read_map

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")

from edgemap.bridges.fleet import keeper as keepers
from edgemap.bridges.fleet import network
from edgemap.bridges.fleet.access import SECRET, read_passwords
from edgemap.bridges.fleet.inbox import MAXIMUM_ROBOTS, ON_TRIAL, Inbox
from edgemap.bridges.fleet.keeper import PlaceKeeper
from edgemap.bridges.fleet.network import open_session, packed, unpacked_map
from edgemap.cli.fleet_serve import lines


@pytest.fixture
def address():
    return f"127.0.0.1:{free_port()}"


@pytest.fixture
def keeper(tmp_path, address):
    kept = PlaceKeeper("home", tmp_path, listen=address)
    yield kept
    kept.close()


def home(robots, seed=3, count=14):
    """Maps of a room by robots that began anywhere."""
    random = np.random.default_rng(seed)
    room = furnished(random, count)
    return [mapped(room, somewhere(random), random, sigma_m=0.04) for _ in range(robots)]


def tell(keeper, name, objects, annotations=None, kind="map"):
    keeper.inbox.put(kind, name, packed(map_document(objects, annotations or Annotations())))


def robots(keeper):
    return keeper.document()["fleet"]["robots"]


def test_a_zone_and_an_object_of_its_name_are_one_map(keeper, tmp_path):
    one, two = home(2)
    two[0] = replace(two[0], id="zone-1")
    tell(keeper, "one", one, Annotations((Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))),)))
    tell(keeper, "two", two)
    assert keeper.update()
    assert all("pose_place_map" in robot for robot in robots(keeper).values())
    assert load_map(tmp_path / "map.json")


def test_a_robot_with_which_the_map_is_none_is_left_out_by_name(keeper, tmp_path, monkeypatch):
    def reads(text, *more):
        if b'"boom' in text:
            raise MapError("more than a map may hold")
        return read_map(text, *more)

    monkeypatch.setattr(keepers, "read_map", reads)
    one, two, three = home(3)
    tell(keeper, "one", one)
    tell(keeper, "two", two)
    assert keeper.update()
    counted = sum(item.count for item in load_map(tmp_path / "map.json"))
    tell(keeper, "bad", [*three[1:], replace(three[0], id="boom-1", label="boom")])
    tell(keeper, "one", [replace(item, confidence=0.5) for item in one])  # the newest is not to blame
    assert keeper.update()
    told = robots(keeper)
    assert told["bad"]["refused"] == "left out, with it the merged map is none: more than a map may hold"
    assert "pose_place_map" in told["one"]
    assert sum(item.count for item in load_map(tmp_path / "map.json")) == counted
    tell(keeper, "bad", three)
    assert keeper.update()
    assert "pose_place_map" in robots(keeper)["bad"]


def test_what_an_object_of_one_robot_brings_is_bounded(keeper):
    (objects,) = home(1)
    many = {f"label{k}": k / 1000.0 for k in range(1000)}
    views = tuple((float(k), 0.0) for k in range(10_000))
    tell(keeper, "one", [replace(objects[0], labels=many, seen_from_m=views), *objects[1:]])
    assert keeper.update()
    item = next(item for item in keeper.merged.objects if item.id == objects[0].id)
    assert (len(item.labels), len(item.seen_from_m), max(item.labels.values())) == (10, 100, 0.999)


def test_too_many_objects_are_counted_before_one_is_made():
    objects = mapped([("chair", float(k % 100), float(k // 100)) for k in range(1001)])
    document = map_document(objects)
    begun_s = time.process_time()
    for text in (packed(document), packed({**document, "objects": document["objects"] * 8})):
        with pytest.raises(MapError, match="more than 1000 objects"):
            unpacked_map(text, "map of bad")
    hidden = json.dumps(document).replace('"covariance_m2"', '"covarianc\\u0065_m2"')
    import zlib

    with pytest.raises(MapError, match="more than 1000 objects"):
        unpacked_map(zlib.compress(hidden.encode()), "map of bad")
    assert time.process_time() - begun_s < 1.0


def test_a_costly_map_makes_nobody_wait_for_long():
    random = np.random.default_rng(0)
    costly = mapped([("chair", *random.uniform(-10, 10, 2)) for _ in range(924)])
    maps = {f"robot{k}": RobotMap(f"key{k}", tuple(objects)) for k, objects in enumerate(home(6))}
    known, budget = {}, MergeBudget()
    for turn in range(2):  # it sends another map every time
        maps["costly"] = RobotMap(f"costly{turn}", tuple(costly))
        budget.arrived["costly"] = turn + 1
        place = merge_place(maps, None, known, budget)
        assert budget.lately.total() <= 2 * TOTAL_UNITS  # this merge's, and half of those before
    joined = [name for name, member in place.members.items() if member.pose_place_map is not None]
    assert joined == [f"robot{k}" for k in range(6)]


def test_nobody_waits_for_strangers_that_fit_nowhere():
    random = np.random.default_rng(0)
    maps = {f"robot{k}": RobotMap(f"key{k}", tuple(objects)) for k, objects in enumerate(home(3))}
    strangers = {f"invented{k}": RobotMap(f"invented{k}", tuple(junk(random, 30))) for k in range(100)}
    known, budget = {}, MergeBudget()
    merge_place({name: maps[name] for name in ("robot0", "robot1")}, None, known, budget)
    for _ in range(4):
        merge_place({**strangers, "robot0": maps["robot0"], "robot1": maps["robot1"]}, None, known, budget)
    assert not budget.waiting  # all were tried against the place; they try each other now
    assert budget.unfinished
    place = merge_place({**strangers, **maps}, None, known, budget)
    assert place.members["robot2"].pose_place_map is not None


def test_one_robot_under_thirty_names_keeps_no_two_others_apart():
    """All invented maps are new in every merge, so that no alignment of theirs stays known."""
    random, known, budget = np.random.default_rng(0), {}, MergeBudget()
    maps = {f"robot{k}": RobotMap(f"key{k}", tuple(objects)) for k, objects in enumerate(home(2))}
    for merge in range(4):
        invented = {f"name{k}": RobotMap(f"{k} of {merge}", tuple(junk(random, 16))) for k in range(30)}
        place = merge_place({**invented, **(maps if merge > 1 else {})}, None, known, budget)
    joined = [name for name, member in place.members.items() if member.pose_place_map is not None]
    assert joined == ["robot0", "robot1"]


def test_a_merge_stops_when_it_is_asked_to(keeper, tmp_path):
    for name, objects in zip(("one", "two"), home(2), strict=True):
        tell(keeper, name, objects)
    assert not keeper.update(lambda: True)
    assert not (tmp_path / "map.json").exists()
    maps = {str(k): RobotMap(str(k), tuple(objects)) for k, objects in enumerate(home(2))}
    with pytest.raises(MergeStopped):
        merge_place(maps, budget=MergeBudget(stopped=lambda: True))
    assert keeper.update()
    assert load_map(tmp_path / "map.json")


def test_a_liar_moves_no_object_far():
    honest = home(6)
    maps = {f"robot{k}": RobotMap(f"key{k}", tuple(objects)) for k, objects in enumerate(honest)}
    truth = {item.id: item.position_m for item in merge_place(maps).objects}
    lies = [
        replace(
            item,
            position_m=item.position_m + ([0.7, 0.0] if k < 5 else [0.0, 0.0]),
            covariance_m2=np.eye(2) * 1e-6,
            count=1 << 20,
        )
        for k, item in enumerate(sorted(honest[0], key=lambda item: item.id))
    ]
    place = merge_place({**maps, "liar": RobotMap("lies", tuple(lies))})
    assert place.members["liar"].pose_place_map is not None
    moved_m = [min(np.linalg.norm(item.position_m - known) for item in place.objects) for known in truth.values()]
    assert max(moved_m) < 0.25


def test_robots_that_agree_are_merged_as_before():
    (one,) = mapped([("chair", 0.0, 0.0)], told_sigma_m=0.3)  # above the floor that two robots share
    near, far = replace(one, position_m=np.array([0.1, 0.0])), replace(one, covariance_m2=np.eye(2) * 0.16)
    assert balanced([one, near]).position_m == pytest.approx([0.05, 0.0])
    assert balanced([one, far]).count == 2 * one.count
    assert balanced([one, one, near]).position_m[0] < 0.05


def test_names_without_a_map_give_way_and_hold_no_room():
    inbox = Inbox(["robot0"])
    for k in range(500):
        inbox.put("here", f"stranger{k}", b"1")
    assert len(inbox.take()) == MAXIMUM_ROBOTS + ON_TRIAL - 1
    inbox.put("map", "robot1", b"m")
    assert inbox.take() == {("map", "robot1"): b"m"}
    assert inbox.knows("robot0")


def test_of_more_names_with_maps_than_there_is_room_for_each_has_the_same_chance():
    rooms, late = MAXIMUM_ROBOTS + ON_TRIAL, 0
    for _ in range(100):
        inbox = Inbox([])
        for k in range(2 * rooms):
            inbox.put("map", f"stranger{k}", b"m")
        taken = inbox.take()
        assert len(taken) == rooms
        late += sum(int(name.removeprefix("stranger")) >= rooms for _, name in taken)
    assert late / rooms / 100 == pytest.approx(0.5, abs=0.05)  # 0.005 is one standard deviation


def junk(random, count=6):
    """A map that fits nowhere."""
    return mapped([("chair", *random.uniform(-20, 20, 2)) for _ in range(count)])


def test_a_hundred_invented_names_with_maps_shut_no_honest_robot_out(keeper, tmp_path):
    random, honest = np.random.default_rng(0), home(3)
    for number in range(2):
        tell(keeper, f"honest{number}", honest[number])
    keeper.update()
    for k in range(200):
        tell(keeper, f"invented{k}", junk(random))
    assert looked_at_within(keeper, 10)
    tell(keeper, "honest2", honest[2])
    for k in range(20):  # others go on coming
        tell(keeper, f"more{k}", junk(random))
    keeper.update()
    assert "pose_place_map" in robots(keeper)["honest2"]
    for k in range(300):
        tell(keeper, f"again{k}", junk(random))
    keeper.update()
    assert all("pose_place_map" in robots(keeper)[f"honest{number}"] for number in range(3))
    assert len(robots(keeper)) == len(list((tmp_path / "robots").iterdir())) == MAXIMUM_ROBOTS + ON_TRIAL


def looked_at_within(keeper, turns):
    """Whether every map that came has been tried against the place's after so many updates."""
    for _ in range(turns):
        keeper.update()
        if not keeper.budget.waiting:
            return True
    return False


def test_in_a_full_place_a_robot_that_fits_takes_the_room_of_one_that_is_away(keeper, monkeypatch):
    monkeypatch.setattr(keepers, "MAXIMUM_ROBOTS", 2)
    monkeypatch.setattr("edgemap.bridges.fleet.inbox.MAXIMUM_ROBOTS", 2)
    monkeypatch.setattr("edgemap.bridges.fleet.inbox.ON_TRIAL", 1)
    one, two, three, four = home(4)
    tell(keeper, "one", one)
    tell(keeper, "two", two)
    assert looked_at_within(keeper, 3)
    tell(keeper, "three", three)
    assert looked_at_within(keeper, 3)
    assert sorted(robots(keeper)) == ["one", "three", "two"]
    keeper.robots["two"].heard_s -= 1000.0
    keeper.began_s -= 1000.0
    keeper.update()
    tell(keeper, "four", four)
    assert looked_at_within(keeper, 3)
    assert sorted(robots(keeper)) == ["four", "one", "three"]
    assert all("pose_place_map" in robot for robot in robots(keeper).values())


def test_robots_that_are_away_for_long_go(keeper, tmp_path, monkeypatch):
    one, two = home(2)
    tell(keeper, "one", one)
    tell(keeper, "two", two)
    tell(keeper, "alone", two[:2])
    assert keeper.update()
    keeper.inbox.put("here", "one", b"1")
    monkeypatch.setattr(keepers, "EXPIRES_S", {"apart": 0.0, "merged": 1e9})
    keeper.update()
    assert sorted(robots(keeper)) == ["one", "two"]
    monkeypatch.setattr(keepers, "EXPIRES_S", {"apart": 0.0, "merged": 0.0})
    keeper.update()
    assert sorted(robots(keeper)) == ["one"]
    assert [path.name for path in (tmp_path / "robots").iterdir()] == ["one.json"]


def test_keys_of_nobody_are_one_line_each(keeper, address):
    stranger = open_session(connect=address, wait_s=5.0)
    for key in ("robots/*/map", "robots/bad/*", "robots/**", "robots/x/other"):
        stranger.put(f"edgemap/fleet/home/{key}", b"x")
    wait_for(lambda: len(keeper.strangers) >= 2, "two messages")
    stranger.close()
    assert all("is no robot's: ignored" in line and "\n" not in line for line in keeper.strangers)
    assert not keeper.robots


def test_without_the_secret_nobody_is_let_in(tmp_path, address, monkeypatch):
    monkeypatch.setenv(SECRET, "correct-horse-battery")
    kept = PlaceKeeper("home", tmp_path, listen=address)
    try:
        open_session(connect=address, wait_s=5.0).close()
        for secret in ("wrong-horse-battery", ""):
            monkeypatch.setitem(os.environ, SECRET, secret)
            with pytest.raises(PublishError, match="connecting to"):
                open_session(connect=address, wait_s=1.0)
        monkeypatch.setenv(SECRET, "short")
        with pytest.raises(PublishError, match="8 to 200 printable"):
            open_session(connect=address, wait_s=1.0)
    finally:
        kept.close()


def test_a_robot_with_a_password_of_its_own_can_invent_no_other(tmp_path, address, monkeypatch):
    """And of a hundred names that it tries, none delays an honest map, nor is there trace of any."""
    file = tmp_path / "robots.txt"
    file.write_text("# the hall\nvacuum:first-password\nmower:second-password\n\nbad:third-password\n")
    (tmp_path / "home/robots").mkdir(parents=True)
    (tmp_path / "home/robots/invented0.json").write_text(json.dumps(map_document(home(1)[0])))
    monkeypatch.setenv(SECRET, "who-asks-for-the-map")
    kept = PlaceKeeper("home", tmp_path / "home", listen=address, passwords=read_passwords(file))
    assert not kept.robots
    sessions = {}
    for robot in ("vacuum:first-password", "mower:second-password", "bad:third-password", "who-asks-for-the-map"):
        monkeypatch.setenv(SECRET, robot)
        sessions[robot.partition(":")[0]] = open_session(connect=address, wait_s=5.0)
    random, root = np.random.default_rng(0), "edgemap/fleet/home/robots"
    try:
        for sender in ("bad", "who-asks-for-the-map"):
            for k in range(100):
                name = ("mower", "vacuum", f"invented{k}")[min(k, 2)]
                sessions[sender].put(f"{root}/{name}/map", packed(map_document(junk(random, 16))))
                sessions[sender].liveliness().declare_token(f"{root}/{name}")
        for name, objects in zip(("vacuum", "mower"), home(2), strict=True):
            sessions[name].put(f"{root}/{name}/map", packed(map_document(objects)))
        sessions["bad"].put(f"{root}/bad/map", packed(map_document(junk(random, 16))))
        end_s = time.monotonic() + 20.0
        while set(kept.robots) != {"vacuum", "mower", "bad"} and time.monotonic() < end_s:
            kept.update()
            time.sleep(0.05)
        assert {name for name, robot in robots(kept).items() if "pose_place_map" in robot} == {"vacuum", "mower"}
        assert set(robots(kept)) == {"vacuum", "mower", "bad"}
        replies = [reply.ok for reply in sessions["who-asks-for-the-map"].get("edgemap/fleet/home/map", timeout=5.0)]
        assert any(replies)
        for secret in ("mower:first-password", "invented0:first-password", "another-shared-secret"):
            monkeypatch.setenv(SECRET, secret)
            with pytest.raises(PublishError, match="connecting to"):
                open_session(connect=address, wait_s=1.0)
    finally:
        for session in sessions.values():
            session.close()
        kept.close()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "0 robots"),
        ("vacuum first-password", "line 1: not a robot's NAME:PASSWORD"),
        ("vacuum:short", "line 1: not"),
        ("a/b:first-password", "line 1: not"),
        ("edgemap:first-password", "line 1: not"),
        ("vacuum:first-password\nvacuum:second-password", "line 2: vacuum has a password already"),
        ("".join(f"robot{k}:first-password\n" for k in range(101)), "101 robots"),
    ],
)
def test_files_of_passwords_that_cannot_be_meant(tmp_path, text, reason):
    (tmp_path / "robots.txt").write_text(text)
    with pytest.raises(PublishError, match=reason):
        read_passwords(tmp_path / "robots.txt")


def test_a_keeper_has_no_robots_password(tmp_path, address, monkeypatch):
    monkeypatch.setenv(SECRET, "vacuum:first-password")
    with pytest.raises(PublishError, match="is that of the robot vacuum"):
        PlaceKeeper("home", tmp_path, listen=address, passwords={"vacuum": "first-password"})


@pytest.mark.parametrize(
    ("robot", "shown"),
    [
        ({}, None),
        ({"apart": None, "pose_place_map": None}, None),
        ({"pose_place_map": [1.0, 2.0, 0.5]}, "first, its frame at x 1.00 m"),
        ({"pose_place_map": [1.0, 2.0, 0.5], "pairs": 3, "refused": None}, "3 of 0 matched"),
        ({"apart": "too few"}, "apart: too few"),
    ],
)
def test_a_keepers_answer_is_shown_or_refused_in_one_line(robot, shown, monkeypatch):
    document = map_document(mapped([("chair", 0.0, 0.0)]))
    document["fleet"] = {"place": "home", "robots": {"a": {"here": True, "objects": 1, **robot}}}

    class Session:
        ok = payload = property(lambda self: self)

        def to_bytes(self):
            return packed(document)

        def get(self, key, timeout):
            return [self]

        def close(self):
            pass

    monkeypatch.setattr(network, "open_session", lambda **_: Session())
    if shown is None:
        with pytest.raises(MapError, match="a robot has a pose in the place, or is apart"):
            network.place_document("home", "127.0.0.1:1")
    else:
        assert shown in lines(network.place_document("home", "127.0.0.1:1")[0]["fleet"]["robots"])["a"]
