"""`edgemap run --view` as a user starts it: a process with a page beside it."""

import json
import signal
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from support.http_client import Api
from support.live import raw_viewer
from support.rooms import content_of

from edgemap.cli import main


@pytest.fixture
def start(started, tmp_path, floorless_bundle):
    """start("--frames", "3") -> (process, port): a run with a page, once it has said where."""

    def begin(*arguments):
        command = ("run", "--view", "127.0.0.1:0", "--bundle", floorless_bundle, "--out", tmp_path / "run0", *arguments)
        process = started(*command, stderr=subprocess.PIPE)
        line = process.stdout.readline()
        assert line.startswith("live page:  http://127.0.0.1:"), line + process.communicate()[1]
        return process, int(line.rsplit(":", 1)[1].strip().rstrip("/"))

    return begin


def read_until(process, text):
    """Lines that it prints, up to the one that holds the text."""
    lines = []
    for line in process.stdout:
        lines.append(line)
        if text in line:
            return lines
    raise AssertionError(f"never said {text!r}: {lines} {process.stderr.read()}")


def test_a_held_run_goes_on_where_it_was_and_ctrl_c_ends_a_held_one(start, tmp_path):
    process, port = start("--camera", "demo")
    with raw_viewer(port) as viewer:

        def until(condition):
            while not condition(update := viewer.update()):
                viewer.say("shown")
            viewer.say("shown")
            return update

        viewer.say("stream")
        until(lambda update: update.get("frame", 0) >= 2)
        Api(port)("POST", "/api/pause", {"paused": True})
        until(lambda update: update["state"] == "paused")
        held, after = until(lambda update: True), until(lambda update: True)  # the frame under way, and a sign of life
        assert after["frame"] == held["frame"]
        Api(port)("POST", "/api/pause", {"paused": False})
        last = until(lambda update: update["frame"] >= held["frame"] + 3)["frame"]
        Api(port)("POST", "/api/pause", {"paused": True})
        until(lambda update: update["state"] == "paused")
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert "the page stays" not in output
    stamps = np.loadtxt(tmp_path / "run0" / "trajectory.tum")[:, 0]
    assert last < len(stamps) < 200
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=1e-6)  # every frame, in order, none twice
    assert json.loads((tmp_path / "run0" / "run.json").read_text())["finished"]


def test_edits_reach_the_map_on_disk_in_a_held_run_and_after_its_end(start, edgemap, floorless_bundle, tmp_path):
    """And `--config-options`, or a recording that holds them, takes them at the same frames again."""
    tape = tmp_path / "tape.mcap"
    process, port = start("--camera", "demo", "--frames", "25", "--record", f"lossless:{tape}")
    api, folder = Api(port), tmp_path / "run0"
    while not (found := api.get("/api/objects")):
        time.sleep(0.05)
    identity = found[0]["id"]
    assert api("POST", "/api/pause", {"paused": True})[0] == 200
    assert api("PATCH", f"/api/objects/{identity}", {"name": "held"})[0] == 200
    assert '"name": "held"' in (folder / "map.json").read_text()
    api("POST", "/api/pause", {"paused": False})
    read_until(process, "the page stays at")
    zone = {"name": "hall", "corners_m": [[0, 0], [1, 0], [1, 1]]}
    assert api("POST", "/api/zones", zone)[0] == 201
    saved = json.loads((folder / "map.json").read_text())
    assert [zone["name"] for zone in saved["zones"]] == ["hall"]
    assert "held" in {item.get("name") for item in saved["objects"]}
    assert "hall" in (folder / "report.html").read_text()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=120) == 0
    edits = [json.loads(line) for line in (folder / "edits.jsonl").read_text().splitlines()]
    assert [edit["do"] for edit in edits] == ["name", "zone"]
    assert 0 < edits[0]["frames"] < edits[1]["frames"] == 25
    for name, source in (("demo", ["--config", str(folder), "--config-options"]), (str(tape), [])):
        again = ("run", "--bundle", floorless_bundle, "--camera", name, *source)
        edgemap.ok(*again, "--out", tmp_path / Path(name).stem)
    assert content_of(tmp_path / "demo") == content_of(folder)
    replayed = json.loads((tmp_path / "tape" / "map.json").read_text())
    assert replayed["objects"] == saved["objects"]
    assert "zones" not in replayed  # drawn after the recording's end


def test_a_taken_port_ends_the_run_before_it_begins(floorless_bundle, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(SystemExit) as ended:
            main(["run", "--view", address, "--bundle", str(floorless_bundle), "--out", str(tmp_path / "other")])
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{address} (Address already in use)" in line
    assert not (tmp_path / "other").exists()
