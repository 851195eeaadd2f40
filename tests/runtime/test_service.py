"""The service file as systemd reads it, and what a run tells systemd."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from edgemap.runtime.outputs.service import ServiceNotifier

UNIT = Path(__file__).parents[2] / "deploy" / "edgemap.service"


@pytest.fixture
def manager(tmp_path):
    """A notify socket, as systemd's."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(0.2)
        yield listener


def heard(manager):
    messages = []
    while True:
        try:
            messages += manager.recv(4096).decode().split("\n")
        except TimeoutError:
            return messages


def test_systemd_finds_nothing_wrong_with_the_unit(tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    text = UNIT.read_text().replace("/opt/edgemap/bin/edgemap", sys.executable)
    unit = tmp_path / "edgemap.service"
    unit.write_text(text)
    run = subprocess.run(["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")


def test_ready_once_then_the_watchdog_four_times_within_its_time(manager):
    now = [0.0]
    environment = {"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "8000000"}
    notifier = ServiceNotifier(environment, lambda: now[0])
    for step in range(100):  # 10 s
        now[0] = step / 10
        notifier.beat(f"camera running, {step // 30} objects")
    notifier.stopping()
    messages = heard(manager)
    assert messages[0] == "READY=1"
    assert messages.count("READY=1") == 1
    assert messages.count("WATCHDOG=1") == 5  # at 0, 2, 4, 6 and 8 s
    assert [m for m in messages if m.startswith("STATUS")][-1] == "STATUS=camera running, 2 objects"
    assert messages[-1] == "STOPPING=1"


def test_the_watchdog_of_another_process_is_not_fed(manager):
    environment = {"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "8000000", "WATCHDOG_PID": "1"}
    ServiceNotifier(environment).beat("on")
    assert heard(manager) == ["READY=1", "STATUS=on"]


def test_an_abstract_socket_and_a_manager_that_is_gone():
    name = f"@edgemap-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name[1:])
        listener.settimeout(0.2)
        notifier = ServiceNotifier({"NOTIFY_SOCKET": name})
        notifier.beat("on")
        assert heard(listener)[0] == "READY=1"
    notifier.stopping()
    ServiceNotifier({}).beat("nobody listens")
