"""`make integration`: keepers and robots as processes of their own, and messages that are no maps."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from support.waiting import free_port, wait_for

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")
if not os.environ.get("EDGEMAP_INTEGRATION"):
    pytest.skip("real counterparts: make integration", allow_module_level=True)

from edgemap.bridges.fleet.network import open_session
from edgemap.runtime.step.map_file import load_map

PATIENCE_S = 240.0


def edgemap(folder, *words, robot=""):
    log = (folder / f"{'-'.join(words[:3])}.log".replace("/", "_")).open("w")
    command = [sys.executable, "-m", "edgemap.cli", *words]
    return subprocess.Popen(
        command, cwd=folder, stdout=log, stderr=subprocess.STDOUT, env={**os.environ, "EDGEMAP_ROBOT": robot}
    )


def members(folder):
    """The robots of a place that are in its map."""
    try:
        robots = json.loads((folder / "map.json").read_text())["fleet"]["robots"]
    except (OSError, ValueError):
        return set()
    return {name for name, robot in robots.items() if "pose_place_map" in robot}


def test_two_places_their_robots_and_damaged_messages(tmp_path):
    ports = {"home": free_port(), "garden": free_port()}
    keepers = {
        place: edgemap(tmp_path, "fleet", "serve", place, "--listen", f"127.0.0.1:{port}", "--every", "1")
        for place, port in ports.items()
    }
    robots = [
        edgemap(tmp_path, "run", "--frames", "120", "--threads", "1",
                "--sink", f"fleet:{place}@127.0.0.1:{ports[place]}", "--out", f"run-{robot}", robot=robot)
        for place, robot in (("home", "one"), ("home", "two"), ("garden", "three"))
    ]  # fmt: skip
    try:
        assert [robot.wait(PATIENCE_S) for robot in robots] == [0, 0, 0]
        wait_for(lambda: members(tmp_path / "home") == {"one", "two"}, "home's robots", PATIENCE_S, 0.5)
        wait_for(lambda: members(tmp_path / "garden") == {"three"}, "garden's robot", PATIENCE_S, 0.5)
        before = {place: len(load_map(tmp_path / place)) for place in ports}
        stranger = open_session(connect=f"127.0.0.1:{ports['home']}", wait_s=10.0)
        for number in range(60):
            stranger.put(f"edgemap/fleet/home/robots/bad{number % 20}/map", b"x" * 200_000)
            stranger.put("edgemap/fleet/home/robots/*/map", b"x")
        time.sleep(3.0)
        stranger.close()
        assert {place: len(load_map(tmp_path / place)) for place in ports} == before
        for keeper in keepers.values():
            keeper.send_signal(signal.SIGTERM)
            assert keeper.wait(30.0) == 0
        assert "Traceback" not in "".join(path.read_text() for path in tmp_path.glob("*.log"))
    finally:
        for process in (*keepers.values(), *robots):
            if process.returncode is None:
                process.kill()
                process.wait()
