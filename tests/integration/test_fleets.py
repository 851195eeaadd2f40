"""`make integration`: keepers and robots as processes of their own, and one hostile among them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")
if not os.environ.get("EDGEMAP_INTEGRATION"):
    pytest.skip("real counterparts: make integration", allow_module_level=True)

from support.rooms import mapped

from edgemap.runtime.outputs.fleet.network import open_session, packed
from edgemap.runtime.step.map_file import load_map, map_document

PATIENCE_S = 240.0
STOP_CPU_S = 2.0


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def edgemap(folder, *words):
    log = (folder / f"{'-'.join(words[:3])}.log".replace("/", "_")).open("w")
    command = [sys.executable, "-m", "edgemap.cli", *words]
    return subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT)


def until(true, what):
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if true():
            return
        time.sleep(0.5)
    raise AssertionError(what)


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


def cpu_s(pid):
    """Processor time that a process has used, s."""
    import psutil

    times = psutil.Process(pid).cpu_times()
    return times.user + times.system
