"""Live outputs as a user starts them: a process, and a client beside it."""

import json
from functools import partial
from importlib.util import find_spec

import pytest
from support.broker import MISSING, Broker
from support.pictures import write_round
from support.waiting import free_port

from edgemap.cli import main
from edgemap.runtime.frames import extras
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.step.map_file import load_map


@pytest.fixture
def start(started, tmp_path, painted_bundle):
    """start("--foxglove", …) -> a run of the demo in a process of its own."""
    return partial(started, "run", "--bundle", painted_bundle, "--out", tmp_path / "run")


def test_one_command_to_a_live_map_in_foxgloves_protocol(start):
    pytest.importorskip("foxglove")
    client = pytest.importorskip("websockets.sync.client")
    line = start("--foxglove", "127.0.0.1:0").stdout.readline()
    assert line.startswith("Foxglove:  ws://127.0.0.1:")
    with client.connect(line.split()[1], subprotocols=["foxglove.sdk.v1"]) as socket:
        assert json.loads(socket.recv(timeout=60))["name"] == "edgemap"
        channels = {item["topic"]: item["id"] for item in json.loads(socket.recv(timeout=60))["channels"]}
        wish = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channels["/map/markers"]}]}
        socket.send(json.dumps(wish))
        while True:
            message = socket.recv(timeout=60)
            if message[0] == 1 and b"chair-1\x00" in message:
                break


@pytest.mark.skipif(bool(MISSING), reason=f"not here: {', '.join(MISSING)}")
def test_a_run_tells_a_broker_what_appears(start, tmp_path, monkeypatch):
    pytest.importorskip("paho.mqtt")
    broker = Broker(tmp_path)
    listener = broker.listen("edgemap/vacuum/#")
    try:
        monkeypatch.setenv("EDGEMAP_ROBOT", "vacuum")
        start("--mqtt", f"127.0.0.1:{broker.port}")
        told = {}
        while "edgemap/vacuum/events" not in told:
            topic, payload = listener.stdout.readline().rstrip("\n").split("\t")
            told[topic] = payload
        assert told["edgemap/vacuum/status"] == "online"
        assert json.loads(told["edgemap/vacuum/events"])["event_type"] == "appeared"
    finally:
        listener.kill()
        listener.communicate()
        broker.stop()


@pytest.mark.parametrize(("text", "host"), [("robot", "robot"), ("[::1]", "::1")])
def test_addresses(text, host):
    assert host_and_port(text, "--x", 9) == (host, 9)
    assert host_and_port(f"{text}:80", "--x", 9) == (host, 80)


@pytest.mark.parametrize("text", ["", ":80", "x:", "x:http", "x:65536", "x:-1", "x:²", "x:" + "9" * 5000, "h\udcff1"])
def test_addresses_that_are_none(text):
    with pytest.raises(UsageError, match=r"--x .* (expected HOST or HOST:PORT|no name of a host)"):
        host_and_port(text, "--x", 9)


@pytest.mark.parametrize(
    ("words", "package"),
    [
        ("run --foxglove", "foxglove"), ("run --mqtt=127.0.0.1", "paho"), ("run --sink=fleet:home", "zenoh"),
        ("run --view", "uvicorn"), ("run --record=a.mcap", "mcap"), ("run --ros2", "cyclonedds"),
        ("fleet serve home", "zenoh"),
    ],
)  # fmt: skip
def test_without_the_extra_one_line_names_it_at_once(tmp_path, words, package, monkeypatch, capsys):
    """And there is no folder; one with robots/ would be taken for the map of that name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == package else find_spec(name))
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert words.split()[1].partition("=")[0] in line
    assert f" needs {package}" in line
    assert "pip install" in line
    assert not list(tmp_path.iterdir())


def test_two_robots_one_map_by_commands_alone(edgemap, started, painted_bundle, tmp_path, capsys, monkeypatch):
    """A keeper and two robots that see the same, as processes of their own, and somebody who asks late."""
    pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")
    address = f"127.0.0.1:{free_port()}"
    place = tmp_path / "home"
    keeper = started("fleet", "serve", "home", "-o", place, "--listen", address, "--every", "0.2")
    assert keeper.stdout.readline() == f"map of home: {place}/map.json\n"
    drive = ("run", *write_round(tmp_path), "--bundle", painted_bundle, "--sink", f"fleet:home@{address}", "--out")
    for name in ("one", "two"):
        monkeypatch.setenv("EDGEMAP_ROBOT", name)
        edgemap.ok(*drive, tmp_path / name)
        assert "output" not in json.loads((tmp_path / name / "run.json").read_text())["fault_kinds"]
    while True:
        main(["fleet", "show", f"home@{address}", "--json"])
        document = json.loads(capsys.readouterr().out)
        robots = document["fleet"]["robots"]
        if all(robots.get(name, {}).get("objects") and not robots[name]["here"] for name in ("one", "two")):
            break
    main(["fleet", "show", f"home@{address}", "-o", str(tmp_path / "late.json")])
    assert f"{len(document['objects'])} objects in home, saved in" in capsys.readouterr().out
    one, two = (load_map(tmp_path / name) for name in ("one", "two"))
    late = load_map(tmp_path / "late.json")
    assert len(late) == len(one) == len(two) == 5
    assert sum(item.count for item in late) == sum(item.count for item in [*one, *two])
    again = edgemap(*drive, tmp_path / "x", "--map", tmp_path / "late.json")
    assert "what they saw would count twice" in again.stderr
    keeper.terminate()
    keeper.communicate(timeout=120)
    assert keeper.returncode == 0
    assert [item.id for item in load_map(place)] == [item.id for item in late]
