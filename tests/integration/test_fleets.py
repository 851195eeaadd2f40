"""`make integration`: keepers and robots as processes of their own, and one hostile among them."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.waiting import free_port, wait_for

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")
if not os.environ.get("EDGEMAP_INTEGRATION"):
    pytest.skip("real counterparts: make integration", allow_module_level=True)

import numpy as np
from support.rooms import furnished, mapped, somewhere

from edgemap.bridges.fleet.access import SECRET
from edgemap.bridges.fleet.network import open_session, packed
from edgemap.runtime.step.map_file import load_map, map_document

PATIENCE_S = 240.0
STOP_CPU_S = 2.0


def edgemap(folder, *words):
    log = (folder / f"{'-'.join(words[:3])}.log".replace("/", "_")).open("w")
    command = [sys.executable, "-m", "edgemap.cli", *words]
    return subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT)


def until(true, what):
    wait_for(true, what, PATIENCE_S, 0.5)


def members(folder):
    """The robots of a place that are in its map."""
    try:
        robots = json.loads((folder / "map.json").read_text())["fleet"]["robots"]
    except (OSError, ValueError):
        return set()
    return {name for name, robot in robots.items() if "pose_place_map" in robot}


def test_two_places_their_robots_and_a_hostile_one(tmp_path):
    ports = {"home": free_port(), "garden": free_port()}
    keepers = {
        place: edgemap(tmp_path, "fleet", "serve", place, "--listen", f"127.0.0.1:{port}", "--every", "1")
        for place, port in ports.items()
    }
    robots = [
        edgemap(tmp_path, "run", "--frames", "120", "--threads", "1", "--fleet", f"{place}@127.0.0.1:{ports[place]}",
                "--robot", robot, "--out", f"run-{robot}")
        for place, robot in (("home", "one"), ("home", "two"), ("garden", "three"))
    ]  # fmt: skip
    try:
        assert [robot.wait(PATIENCE_S) for robot in robots] == [0, 0, 0]
        until(lambda: members(tmp_path / "home") == {"one", "two"}, "home's robots")
        until(lambda: members(tmp_path / "garden") == {"three"}, "garden's robot")
        before = {place: len(load_map(tmp_path / place)) for place in ports}
        stranger = open_session(connect=f"127.0.0.1:{ports['home']}", wait_s=10.0)
        crowd = map_document(mapped([("chair", 0.1 * k, 0.05 * k) for k in range(900)]))
        crowd["objects"] *= 60
        flood = [packed(crowd), b"x" * 200_000, packed({"objects": [{}] * 60_000})]
        for number in range(60):
            stranger.put(f"edgemap/fleet/home/robots/bad{number % 20}/map", flood[number % 3])
            stranger.put("edgemap/fleet/home/robots/*/map", b"x")
        time.sleep(3.0)
        stranger.close()
        assert {place: len(load_map(tmp_path / place)) for place in ports} == before
        for keeper in keepers.values():
            used_s = cpu_s(keeper.pid)
            keeper.send_signal(signal.SIGTERM)
            _, status, usage = os.wait4(keeper.pid, 0)
            keeper.returncode = os.waitstatus_to_exitcode(status)
            assert keeper.returncode == 0
            assert usage.ru_utime + usage.ru_stime - used_s < STOP_CPU_S
        text = "".join(path.read_text() for path in tmp_path.glob("*.log"))
        assert "Traceback" not in text
    finally:
        for process in (*keepers.values(), *robots):
            if process.returncode is None:
                process.kill()
                process.wait()


HOSTILE = """
import os, socket, sys, time
from edgemap.bridges.fleet.access import SECRET
from edgemap.bridges.fleet.network import open_session, packed
from edgemap.runtime.step.map_file import map_document
import numpy as np
from support.rooms import furnished, mapped, somewhere
address, random, root = sys.argv[1], np.random.default_rng(1), "edgemap/fleet/home/robots"
session, held = open_session(connect=address, wait_s=20.0), []
held += [open_session(connect=address, wait_s=20.0) for _ in range(400)]
places = lambda count: [("chair", *random.uniform(-10, 10, 2)) for _ in range(count)]
large, small = ([packed(map_document(mapped(places(count)))) for _ in range(5)] for count in (924, 16))
for number in range(1 << 30):
    session.put(f"{root}/bad/map", large[number % 5])
    session.put(f"{root}/bad/map", os.urandom(510 << 10))
    for k in range(100):
        session.put(f"{root}/invented{k}/map", small[number % 5])
    if len(held) < 1000:
        held.append(socket.create_connection(address.rsplit(":", 1), timeout=1.0))
    time.sleep(0.02)
"""
LATEST_S = 5.0


def test_an_honest_map_is_in_the_place_in_time_whatever_one_robot_sends(tmp_path, monkeypatch):
    address, random = f"127.0.0.1:{free_port()}", np.random.default_rng(3)
    (tmp_path / "robots.txt").write_text("".join(f"{name}:password-{name}\n" for name in ("a", "b", "c", "bad")))
    keeper = edgemap(tmp_path, "fleet", "serve", "home", "--listen", address, "--robots", "robots.txt")
    processes, room = [keeper], furnished(random, 14)

    def send(name):
        monkeypatch.setenv(SECRET, f"{name}:password-{name}")
        objects = mapped(room, somewhere(random), random, sigma_m=0.04)
        session = open_session(connect=address, wait_s=20.0)
        session.put(f"edgemap/fleet/home/robots/{name}/map", packed(map_document(objects)))
        return session

    try:
        until(lambda: "robots:" in (tmp_path / "fleet-serve-home.log").read_text(), "the keeper")
        sessions = [send("a"), send("b")]
        until(lambda: members(tmp_path / "home") == {"a", "b"}, "the first two robots")
        monkeypatch.setenv(SECRET, "bad:password-bad")
        tests = str(Path(__file__).parents[1])
        path = os.pathsep.join([tests, *filter(None, [os.environ.get("PYTHONPATH")])])
        processes.append(
            subprocess.Popen([sys.executable, "-c", HOSTILE, address], env=os.environ | {"PYTHONPATH": path})
        )
        time.sleep(12.0)
        began_s = time.monotonic()
        sessions.append(send("c"))
        until(lambda: members(tmp_path / "home") == {"a", "b", "c"}, "the third robot")
        assert time.monotonic() - began_s < LATEST_S
        assert len(json.loads((tmp_path / "home/map.json").read_text())["fleet"]["robots"]) <= 4
        assert processes[1].poll() is None
        used_s = cpu_s(keeper.pid)
        keeper.send_signal(signal.SIGTERM)
        _, status, usage = os.wait4(keeper.pid, 0)
        keeper.returncode = os.waitstatus_to_exitcode(status)
        assert (keeper.returncode, usage.ru_utime + usage.ru_stime - used_s < STOP_CPU_S) == (0, True)
    finally:
        for process in processes:
            if process.returncode is None:
                process.kill()
                process.wait()


def cpu_s(pid):
    """Processor time that a process has used, s."""
    import psutil

    times = psutil.Process(pid).cpu_times()
    return times.user + times.system
