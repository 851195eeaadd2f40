"""Robots, a keeper and late joiners over zenoh on this machine, as separate sessions."""

import json
import zlib
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from support.recordings import LENS
from support.results import POSES, results
from support.rooms import furnished, mapped, somewhere
from support.waiting import free_port, wait_for

from edgemap.geometry.errors import MapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.step.map_file import load_map, map_document, save_map

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")
import zenoh

from edgemap.bridges.fleet.keeper import PlaceKeeper
from edgemap.bridges.fleet.network import (
    MAXIMUM_OBJECTS,
    MESSAGE_BYTES,
    ROBOT_BYTES,
    open_session,
    packed,
    place_document,
    unpacked,
)
from edgemap.bridges.fleet.sink import MAP_EVERY_S, FleetSink

PATIENCE_S = 30.0


@pytest.fixture
def address():
    return f"127.0.0.1:{free_port()}"


@pytest.fixture
def opened():
    """Keeps what is given, and closes it at the end."""
    things = []

    def keep(thing):
        things.append(thing)
        return thing

    yield keep
    for thing in things:
        thing.close()


def home(robots, seed=3):
    """Where each robot began in a room, and the map that it made of it."""
    random = np.random.default_rng(seed)
    room = furnished(random, 14)
    began = [somewhere(random) for _ in range(robots)]
    return began, [mapped(room, pose, random, sigma_m=0.04, missed=0.1) for pose in began]


def drive(sink, objects, stamp_s=0.0):
    """One step of a robot at (0.1, 0.02) of its own map."""
    picture = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    (result,) = results([Frame(0, stamp_s, picture)], [POSES[1]])
    sink.write(result, objects)


def drives(sink, objects):
    """Whether the sink takes a step: it has found its keeper."""
    with suppress(PublishError):
        drive(sink, objects, stamp_s=1.0)
        return True
    return False


def until(keeper, true, patience_s=PATIENCE_S):
    """Updates until a place's robots are as wanted; they."""

    def updated():
        keeper.update()
        robots = keeper.document()["fleet"]["robots"]
        return robots if true(robots) else None

    return wait_for(updated, lambda: keeper.document()["fleet"], patience_s)


def together(*names):
    return lambda robots: all("pose_place_map" in robots.get(name, {}) for name in names)


def test_three_robots_one_map_and_who_comes_late_gets_it(tmp_path, address, opened):
    began, maps = home(3)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    sinks = [opened(FleetSink("home", f"robot{k}", address)) for k in range(3)]
    for sink, objects in zip(sinks, maps, strict=True):
        drive(sink, objects)
    all_of_them = together("robot0", "robot1", "robot2")
    robots = until(keeper, lambda robots: all_of_them(robots) and "pose_place_base" in robots["robot2"])
    expected = began[0].inverse() @ began[2]
    assert robots["robot2"]["pose_place_map"] == pytest.approx(expected.vector(), abs=0.15)
    assert robots["robot2"]["pose_place_base"] == pytest.approx((expected @ POSES[1]).vector(), abs=0.15)
    document, text = place_document("home", address)
    assert json.loads(text)["objects"] == document["objects"]
    assert document["fleet"]["robots"]["robot1"]["here"]
    saved = load_map(tmp_path / "map.json")
    assert sorted(item.id for item in saved) == sorted(item["id"] for item in document["objects"])
    assert sum(item.count for item in saved) == sum(item.count for objects in maps for item in objects)


def test_a_robot_that_was_away_replaces_what_it_had_said(tmp_path, address, opened):
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    stays, leaves = (opened(FleetSink("home", name, address)) for name in ("stays", "leaves"))
    drive(stays, maps[0])
    drive(leaves, maps[1])
    until(keeper, together("stays", "leaves"))
    leaves.close()
    robots = until(keeper, lambda robots: not robots["leaves"]["here"])
    assert "pose_place_map" in robots["leaves"]  # what it has seen stays in the map
    back = opened(FleetSink("home", "leaves", address))
    drive(back, maps[1][:3], stamp_s=3590.0)
    robots = until(keeper, lambda robots: robots["leaves"]["here"] and "refused" in robots["leaves"])
    assert f"its map of {len(maps[1])} stays" in robots["leaves"]["refused"]
    assert len(keeper.robots["leaves"].latest.objects) == len(maps[1])
    more = [replace(item, count=item.count + 5) for item in maps[1]]
    drive(back, more, stamp_s=3600.0)
    until(keeper, lambda robots: robots["leaves"]["here"] and keeper.robots["leaves"].latest.objects[0].count == 15)
    counted = sum(item.count for item in keeper.merged.objects)
    assert counted == sum(item.count for objects in (maps[0], more) for item in objects)


def test_robots_that_come_first_and_a_keeper_that_begins_again(tmp_path, address, opened):
    """Each side connects again; a map that did not change in the meantime is asked for."""
    _, maps = home(2)
    sink = opened(FleetSink("home", "early", address))
    with pytest.raises(PublishError, match=r"nobody keeps the map of home at 127\.0\.0\.1:\d+ \(edgemap fleet serve\)"):
        drive(sink, maps[0])
    first = opened(PlaceKeeper("home", tmp_path / "a", listen=address))
    until(first, together("early"))
    wait_for(lambda: drives(sink, maps[0]), "the robot's keeper", PATIENCE_S)
    first.close()
    save_map(tmp_path / "a" / "robots" / "gone.json", maps[1])  # of a robot that will not be back
    second = opened(PlaceKeeper("home", tmp_path / "a", listen=address))
    robots = until(second, lambda robots: together("early", "gone")(robots) and robots["early"]["here"])
    assert not robots["gone"]["here"]


def test_a_map_that_fits_nowhere_stays_apart_until_it_does(tmp_path, address, opened):
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    one, fresh = (opened(FleetSink("home", name, address)) for name in ("one", "two"))
    drive(one, maps[0])
    drive(fresh, maps[1][:2])
    robots = until(keeper, lambda robots: together("one")(robots) and robots.get("two", {}).get("objects") == 2)
    assert "at least 4 are needed" in robots["two"]["apart"]
    assert [item.id for item in load_map(tmp_path / "robots" / "two.json")] == [item.id for item in maps[1][:2]]
    assert len(load_map(tmp_path / "map.json")) == len(maps[0])
    drive(fresh, maps[1], stamp_s=MAP_EVERY_S)
    until(keeper, together("one", "two"))


def test_through_a_router(tmp_path, address, opened, monkeypatch):
    """Neither listens: a zenoh router in between, and for one of them a file of zenoh's own settings."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/{address}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    opened(zenoh.open(config))
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, connect=address))
    drive(opened(FleetSink("home", "one", address)), maps[0])
    settings = tmp_path / "client.json5"
    settings.write_text(json.dumps({"mode": "client", "connect": {"endpoints": [f"tcp/{address}"]}}))
    monkeypatch.setenv("ZENOH_CONFIG", str(settings))
    drive(opened(FleetSink("home", "two", "nowhere:1")), maps[1])
    until(keeper, together("one", "two"))


HOSTILE = [
    b"",
    b"no map",
    zlib.compress(b"{}"),
    zlib.compress(b"\x00" * (ROBOT_BYTES + 1)),
    packed(map_document([]))[:-3],
    packed({"format": "edgemap.map/1", "objects": [{"id": "a"}]}),
    packed({"format": "edgemap.map/1", "objects": [], "zones": "x" * 1000}),
    packed(map_document(mapped([("chair", 1001.0, 0.0)]))),
    packed(map_document(mapped([("chair", float(k), 0.0) for k in range(MAXIMUM_OBJECTS + 1)]))),
]


def test_what_no_robot_sends_is_refused_and_the_map_stays(tmp_path, address, opened):
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    drive(opened(FleetSink("home", "good", address)), maps[0])
    drive(opened(FleetSink("home", "bad", address)), maps[1])
    until(keeper, together("good", "bad"))
    before = keeper.merged.objects
    stranger = opened(open_session(connect=address, wait_s=5.0))
    for message in HOSTILE:
        keeper.robots["bad"].refused = ""
        stranger.put("edgemap/fleet/home/robots/bad/map", message)
        until(keeper, lambda robots: "refused" in robots["bad"])
        stranger.put("edgemap/fleet/home/robots/good/pose", b'{"x_m": 1e300, "y_m": 0, "yaw_rad": 0}')
    until(keeper, lambda robots: "1e+300" in robots["good"].get("refused", ""))
    for key in ("robots/../map", "robots/" + "x" * 100 + "/map", "robots/-/map", "robots/bad/map/more"):
        stranger.put(f"edgemap/fleet/home/{key}", HOSTILE[1])
    stranger.put("edgemap/fleet/home/robots/bad/map", b"x" * (MESSAGE_BYTES + 1))
    drive(opened(FleetSink("home", "later", address)), maps[1])
    robots = until(keeper, together("good", "bad", "later"))
    assert set(robots) == {"good", "bad", "later"}
    assert len(keeper.merged.objects) == len(before)
    assert sorted(path.name for path in (tmp_path / "robots").iterdir()) == ["bad.json", "good.json", "later.json"]


def test_more_robots_than_a_place_has_are_not_kept(tmp_path, address, opened, monkeypatch):
    monkeypatch.setattr("edgemap.bridges.fleet.inbox.MAXIMUM_ROBOTS", 1)
    monkeypatch.setattr("edgemap.bridges.fleet.inbox.ON_TRIAL", 1)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    for name in ("a", "b", "c", "d"):
        opened(FleetSink("home", name, address))
    until(keeper, lambda robots: len(robots) == 2)
    keeper.update()
    assert len(keeper.robots) == 2


def test_the_last_map_is_sent_at_the_end(tmp_path, address, opened):
    _, maps = home(1)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    sink = FleetSink("home", "one", address)
    drive(sink, maps[0][:3])
    drive(sink, maps[0], stamp_s=1.0)  # too soon after the one before
    sink.close()
    sink.close()
    until(keeper, lambda robots: robots["one"]["objects"] == len(maps[0]))


@pytest.mark.parametrize("name", ["", "a/b", "*", "-a", ".", "a" * 65, "é", "a b", "a$*", "a\n"])
def test_names_that_are_no_part_of_a_key(name, address):
    with pytest.raises(PublishError, match="a name has 1 to 64"):
        FleetSink("home", name, address)
    with pytest.raises(PublishError, match="a name has 1 to 64"):
        FleetSink(name, "robot", address)


def test_an_address_that_is_taken_or_silent_is_one_line(tmp_path, address, opened, monkeypatch):
    opened(PlaceKeeper("home", tmp_path / "a", listen=address))
    with pytest.raises(PublishError, match=rf"fleet, listening on {address}: ") as error:
        PlaceKeeper("home", tmp_path / "b", listen=address)
    assert "\n" not in str(error.value)
    monkeypatch.setattr("edgemap.bridges.fleet.network.PATIENCE_S", 0.5)
    with pytest.raises(PublishError, match=r"fleet, connecting to 127\.0\.0\.1:1: "):
        place_document("home", "127.0.0.1:1")
    with pytest.raises(PublishError, match="nobody keeps the map of garden at"):
        place_document("garden", address)


def test_messages_are_a_few_kilobytes():
    """A home's map as sent, with the places that each object was seen from; bounded when read."""
    random = np.random.default_rng(0)
    objects = [
        replace(item, seen_from_m=tuple((float(x), float(y)) for x, y in random.uniform(-4, 4, (12, 2))))
        for item in mapped(furnished(random, 14), SE2(), random, sigma_m=0.05)
    ]
    message = packed(map_document(objects))
    assert len(message) < 4096
    assert json.loads(unpacked(message, "a map")) == json.loads(json.dumps(map_document(objects)))
    with pytest.raises(MapError, match="cut off"):
        unpacked(message[:-1], "a map")
