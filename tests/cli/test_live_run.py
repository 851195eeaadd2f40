"""A run on a live camera, a network camera on this machine: stalls, SIGSTOP, SIGTERM."""

import json
import os
import re
import signal
import socket
import subprocess
import time
from contextlib import suppress
from functools import partial

import pytest
from support import waiting
from support.ending import ended_by_sigterm
from support.mjpeg import MjpegServer

from edgemap.runtime.inputs.open import open_camera

wait_for = partial(waiting.wait_for, limit_s=120.0)


@pytest.fixture(scope="module")
def server():
    with open_camera("demo") as camera:
        pictures = [frame.image for _ in range(40) if (frame := camera.read()) is not None]
    with MjpegServer(10.0, pictures=pictures) as server:
        yield server


@pytest.fixture
def begin(started, painted_bundle):
    def start(camera, out, *words, **environment):
        lens = ("--mount", "0.6,11.5", "--intrinsics", "587,587,319.5,239.5")
        command = ("run", "--camera", camera, "--bundle", painted_bundle, "--out", out, *lens, *words)
        return started(*command, env=os.environ | environment, stderr=subprocess.PIPE)

    return start


def frames_done(out):
    try:
        return json.loads((out / "run.json").read_text())["frames"]
    except (OSError, ValueError):
        return 0


def stopped_cleanly(ending, out):
    """The run's record; it is finished."""
    assert ending.code == 0
    # Faults as they come, and a line of progress every 10 s where the machine is that slow; no traceback.
    assert all(re.match(r"frame \d+: |\d+ frames, ", line) for line in ending.errors.splitlines()), ending.errors
    assert "stopped after" in ending.output
    assert ending.own_s < 2.0
    assert ending.busy_s < 2.0
    record = json.loads((out / "run.json").read_text())
    assert record["finished"]
    return record


def test_a_stall_and_a_stop_do_not_end_a_run_and_sigterm_does_within_two_seconds(begin, server, tmp_path):
    out, heard = tmp_path / "run", []

    def frames_now():
        """Reads the manager's messages too: the system keeps ten that nobody reads, and drops the rest."""
        with suppress(BlockingIOError):
            while True:
                heard.extend(manager.recv(4096).decode().split("\n"))
        return frames_done(out)

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        run = begin(server.url, out, NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="4000000")
        wait_for(lambda: frames_now() >= 5)
        run.send_signal(signal.SIGSTOP)
        time.sleep(2.0)
        run.send_signal(signal.SIGCONT)
        done = frames_now()
        wait_for(lambda: frames_now() > done + 10)
        server.stalled = True
        time.sleep(3.0)
        server.stalled = False
        done = frames_now()
        wait_for(lambda: frames_now() > done + 10)
        ending = ended_by_sigterm(run)
        frames_now()
    record = stopped_cleanly(ending, out)
    assert record["fault_kinds"]["recovered"] >= 1
    cut = {"late", "failed", "closed", "torn", "recovered"}  # a picture too, where the connection was
    assert set(record["fault_kinds"]) <= cut | {"odometry", "out_of_range"}
    assert heard[0] == "READY=1"
    assert heard.count("WATCHDOG=1") >= 5
    assert any(text.startswith("STATUS=camera running") for text in heard)
    assert heard[-1] == "STOPPING=1"


def test_sigterm_while_the_camera_is_away(begin, server, tmp_path):
    """The supervisor sleeps between two attempts to open it, or is in the middle of one."""
    out = tmp_path / "run"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(120.0)
        run = begin(server.url, out, "--view", "127.0.0.1:0", NOTIFY_SOCKET=str(tmp_path / "notify"))
        try:
            wait_for(lambda: frames_done(out) >= 3)
            server.stop()
            while "STATUS=camera degraded" not in manager.recv(4096).decode():
                pass
            wait_for(lambda: "does not open" in (out / "run.json").read_text())  # tried again in vain
            ending = ended_by_sigterm(run)
        finally:
            server.start()
    assert stopped_cleanly(ending, out)["frames"] >= 3
