"""Robots, a keeper and late joiners over zenoh on this machine, as separate sessions."""

import json
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.recordings import LENS
from support.results import POSES, results
from support.rooms import PAIRS, ROOMS, floor, furnished, mapped, somewhere
from support.waiting import free_port, wait_for

from edgemap.cli import main
from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, MapIdentity
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, load_map, map_document, save_map

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")

from edgemap.bridges.fleet.keeper import MAXIMUM_OBJECTS, PlaceKeeper
from edgemap.bridges.fleet.network import open_session
from edgemap.bridges.fleet.sink import MAP_EVERY_S, FleetSink


@pytest.fixture
def address():
    return f"127.0.0.1:{free_port()}"


@pytest.fixture
def opened():
    """Keeps what is given, and closes it at the end."""
    with ExitStack() as opened:
        yield lambda closed_after: opened.enter_context(closing(closed_after))


def home(robots, seed=3):
    """Where each robot began in a room, and the map that it made of it."""
    random = np.random.default_rng(seed)
    room = furnished(random, 14)
    began = [somewhere(random) for _ in range(robots)]
    return began, [mapped(room, pose, random, sigma_m=0.04, missed=0.1) for pose in began]


def drive(sink, objects, stamp_s=0.0, grid=None):
    """One step of a robot at (0.1, 0.02) of its own map."""
    picture = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    (result,) = results([Frame(0, stamp_s, picture)], [POSES[1]])
    with suppress(BridgeError):  # until the keeper is there
        sink.write(replace(result, grid=grid), objects)


def until(keeper, true):
    """Updates until a place's robots are as wanted; they."""

    def updated():
        robots = keeper.update()
        return robots if true(robots) else None

    return wait_for(updated, keeper.update)


def together(*names):
    return lambda robots: all("pose_place_map" in robots.get(name, {}) for name in names)


def test_three_robots_one_map_and_a_late_joiner_gets_it(tmp_path, address, opened, capsys):
    began, maps = home(3)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    for number, objects in enumerate(maps):
        drive(opened(FleetSink("home", f"robot{number}", address)), objects)
    all_of_them = together("robot0", "robot1", "robot2")
    robots = until(keeper, lambda robots: all_of_them(robots) and "pose_place_base" in robots["robot2"])
    expected = began[0].inverse() @ began[2]
    assert robots["robot2"]["pose_place_map"] == pytest.approx(expected.vector(), abs=0.15)
    assert robots["robot2"]["pose_place_base"] == pytest.approx((expected @ POSES[1]).vector(), abs=0.15)
    main(["fleet", "show", f"home@{address}", "--json"])
    document = json.loads(capsys.readouterr().out)
    assert document["fleet"]["robots"]["robot1"]["here"]
    saved = load_map(tmp_path / "map.json")
    assert sorted(item.id for item in saved) == sorted(item["id"] for item in document["objects"])
    assert sum(item.count for item in saved) == sum(item.count for objects in maps for item in objects)
    with pytest.raises(SystemExit):
        main(["fleet", "show", f"garden@{address}"])
    assert "nobody keeps the map of garden at" in capsys.readouterr().err


def test_a_later_map_of_a_robot_replaces_its_earlier_one(tmp_path, address, opened):
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    stays, leaves = (opened(FleetSink("home", name, address)) for name in ("stays", "leaves"))
    drive(stays, maps[0])
    drive(leaves, maps[1])
    until(keeper, together("stays", "leaves"))
    leaves.close()
    robots = until(keeper, lambda robots: not robots["leaves"]["here"])
    assert "pose_place_map" in robots["leaves"]  # its objects stay in the map
    back = opened(FleetSink("home", "leaves", address))
    drive(back, maps[1][:3], stamp_s=3590.0)
    robots = until(keeper, lambda robots: robots["leaves"]["here"] and "refused" in robots["leaves"])
    assert f"its map of {len(maps[1])} stays" in robots["leaves"]["refused"]
    more = [replace(item, count=item.count + 5) for item in maps[1]]
    drive(back, more, stamp_s=3600.0)
    until(keeper, lambda robots: "refused" not in robots["leaves"])
    counted = sum(item.count for item in keeper.merged.objects)
    assert counted == sum(item.count for objects in (maps[0], more) for item in objects)


def test_robots_that_come_first_and_a_keeper_that_begins_again(tmp_path, address, opened):
    """Each side connects again; a map that did not change in the meantime is sent again."""
    _, maps = home(2)
    sink = opened(FleetSink("home", "early", address))
    (result,) = results([Frame(0, 0.0, np.zeros((LENS.height, LENS.width, 3), np.uint8))], [POSES[1]])
    with pytest.raises(BridgeError, match=r"nobody keeps the map of home at 127\.0\.0\.1:\d+ \(edgemap fleet serve\)"):
        sink.write(result, maps[0])
    first = PlaceKeeper("home", tmp_path / "a", listen=address)
    until(first, together("early"))
    first.close()
    save_map(tmp_path / "a" / "robots" / "gone.json", maps[1])  # of a robot that will not be back
    second = opened(PlaceKeeper("home", tmp_path / "a", listen=address))
    robots = until(second, lambda robots: together("early", "gone")(robots) and robots["early"]["here"])
    assert not robots["gone"]["here"]


def test_a_map_that_does_not_fit_stays_apart_until_it_does(tmp_path, address, opened):
    _, maps = home(2)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    one, fresh = (opened(FleetSink("home", name, address)) for name in ("one", "two"))
    drive(one, maps[0])
    drive(fresh, maps[1][:2])
    robots = until(keeper, lambda robots: together("one")(robots) and robots.get("two", {}).get("objects") == 2)
    assert "at least 4 are needed" in robots["two"]["apart"]
    assert len(load_map(tmp_path / "map.json")) == len(maps[0])
    drive(fresh, maps[1], stamp_s=MAP_EVERY_S)
    until(keeper, together("one", "two"))
    fresh.close()  # the map that was sent too soon after the one before is sent at the end
    fresh.close()


def test_walls_join_maps_with_few_objects_and_the_place_has_the_floor(tmp_path, address, opened, capsys):
    began = SE2(2.0, 1.0, 0.7)
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))
    drive(opened(FleetSink("home", "one", address)), mapped(PAIRS), grid=floor(ROOMS))
    drive(opened(FleetSink("home", "two", address)), mapped(PAIRS[:2], began), grid=floor(ROOMS, began))
    robots = until(keeper, together("one", "two"))
    assert robots["two"]["pose_place_map"] == pytest.approx(began.vector(), abs=0.05)
    late = tmp_path / "late.json"
    main(["fleet", "show", f"home@{address}", "-o", str(late)])
    assert f"saved in {late}" in capsys.readouterr().out
    for path in (late, tmp_path, tmp_path / "robots" / "two.json"):
        grid = load_grid(path)
        assert (grid.at(began.inverse().apply([[2.0, 1.5]]) if path.name == "two.json" else [[2.0, 1.5]]) == 0).all()
    keeper.close()
    assert together("one", "two")(opened(PlaceKeeper("home", tmp_path, listen=address)).update())


def sample(kind, name, message):
    """What zenoh hands to a subscriber."""
    payload = SimpleNamespace(to_bytes=lambda: message)
    key = f"edgemap/fleet/home/robots/{name}/{kind}"
    return SimpleNamespace(key_expr=key, kind="PUT", payload=payload, attachment=None)


_, (GOOD, OTHER) = home(2)
DAMAGED = st.one_of(
    st.binary(max_size=200),
    st.recursive(st.none() | st.booleans() | st.floats() | st.text(), lambda some: st.lists(some) | st.dictionaries(
        st.sampled_from(["format", "objects", "zones", "id", "label", "x_m", "x"]), some)).map(
            lambda value: json.dumps(value).encode()),
    st.tuples(st.integers(0, 2000), st.binary(min_size=1, max_size=20)).map(
        lambda cut: json.dumps(map_document(OTHER)).encode()[: cut[0]] + cut[1]),
    st.just(json.dumps(map_document(mapped([("chair", float(k), 0.0) for k in range(MAXIMUM_OBJECTS + 1)]))).encode()),
)  # fmt: skip


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A keeper with the map of one robot, and its folder."""
    folder = tmp_path_factory.mktemp("place")
    keeper = PlaceKeeper("home", folder, listen=f"127.0.0.1:{free_port()}")
    keeper._receive("map", sample("map", "good", json.dumps(map_document(GOOD)).encode()))
    keeper.update()
    yield keeper, load_map(folder / "map.json")
    keeper.close()


@given(st.sampled_from(["map", "pose"]), st.sampled_from(["good", "bad", "..", "x" * 80, ""]), DAMAGED)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_message_ends_the_keeper_or_loses_the_merged_map(kept, kind, name, message):
    keeper, before = kept
    keeper._receive(kind, sample(kind, name, message))
    keeper.update()
    assert map_document(load_map(keeper.folder)) == map_document(before)
    assert {path.name for path in (keeper.folder / "robots").iterdir()} == {"good.json"}
    assert keeper.robots.keys() <= {"good", "bad"}


def test_an_unreadable_merge_leaves_the_saved_map(tmp_path, address, opened):
    keeper = opened(PlaceKeeper("home", tmp_path, listen=address))

    def send(name, objects):
        document = map_document(objects, Annotations(identity=MapIdentity(name)))
        keeper._receive("map", sample("map", name, json.dumps(document).encode()))

    send("one", GOOD)
    keeper.update()
    before = (tmp_path / "map.json").read_bytes()
    endless = [replace(item, count=1 << 40) for item in GOOD]  # twice as many are no count of a map
    send("one", endless)
    send("two", endless)
    with pytest.raises(MapError, match="map of home"):
        keeper.update()
    assert (tmp_path / "map.json").read_bytes() == before
    for name, objects in (("one", GOOD), ("two", OTHER)):
        send(name, objects)
    robots = keeper.update()
    assert together("one", "two")(robots)
    assert [robots[name]["map_id"] for name in ("one", "two")] == ["one", "two"]
    place = load_annotated_map(tmp_path)[1].identity
    assert place == replace(keeper.identity, saved_at=place.saved_at)  # of its own, and kept


@pytest.mark.parametrize("name", ["", "a/b", "*", "-a", ".", "a" * 65, "é", "a b", "a$*", "a\n"])
def test_names_that_are_no_part_of_a_key(name, address):
    with pytest.raises(BridgeError, match="not 1 to 64"):
        FleetSink("home", name, address)
    with pytest.raises(BridgeError, match="not 1 to 64"):
        FleetSink(name, "robot", address)


def test_an_address_that_is_taken_or_silent_is_one_line(tmp_path, address, opened):
    opened(PlaceKeeper("home", tmp_path / "a", listen=address))
    with pytest.raises(BridgeError, match=rf"fleet, listening on {address}: ") as error:
        PlaceKeeper("home", tmp_path / "b", listen=address)
    assert "\n" not in str(error.value)
    with pytest.raises(BridgeError, match=r"fleet, connecting to 127\.0\.0\.1:1: "):
        open_session("127.0.0.1:1", wait_s=0.5)
