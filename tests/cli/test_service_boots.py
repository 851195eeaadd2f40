"""The service file as systemd reads it, what a run reports to systemd, and two boots of the service with one map."""

import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections import defaultdict
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from support.pictures import write_round

from edgemap.cli.service import ServiceNotifier
from edgemap.runtime.step.map_file import load_map

UNIT = Path(__file__).parents[2] / "deploy" / "edgemap.service"
FRAMES = 40  # of each boot at least: once round


def read_unit(text):
    """The settings of [Service]: each with its values, in order; an empty line or a comment is none."""
    settings = defaultdict(list)
    for line in text.partition("[Service]")[2].partition("\n[")[0].splitlines():
        if line and not line.startswith("#"):
            name, _, value = line.partition("=")
            settings[name].append(value)
    return settings


def started(settings, listener, home):
    """The service's process. systemd.service(5): `${NAME}` is one word of the command, `$NAME` as many as it holds."""
    named = dict(word.split("=", 1) for line in settings["Environment"] for word in shlex.split(line))
    for path in settings["EnvironmentFile"]:
        named |= dict(line.split("=", 1) for line in Path(path).read_text().splitlines())
    words = []
    for word in settings["ExecStart"][-1].split():
        whole = re.fullmatch(r"\$(\w+)", word)
        words += named[whole[1]].split() if whole else [re.sub(r"\$\{(\w+)\}", lambda match: named[match[1]], word)]
    program, *arguments = words
    assert program == "/opt/edgemap/bin/edgemap"
    system = {"PATH": os.environ["PATH"], "HOME": str(home), "NOTIFY_SOCKET": listener.getsockname()}
    return subprocess.Popen(
        [sys.executable, "-m", "edgemap.cli", *arguments], env=named | system, cwd=settings["WorkingDirectory"][-1],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def boot(settings, notify, home):
    """One boot, ended by SIGTERM after `FRAMES` frames. notify: path of systemd's socket. What was printed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(notify))
        listener.settimeout(60.0)
        process = started(settings, listener, home)
        try:
            ready, frames = False, 0
            while frames < FRAMES:
                message = listener.recv(4096).decode()
                ready |= "READY=1" in message.split("\n")
                frames = int(found[1]) if (found := re.search(r"(\d+) frames", message)) else frames
            assert ready
            process.terminate()
            printed, _ = process.communicate(timeout=float(settings["TimeoutStopSec"][-1]))
        finally:
            process.kill()
    assert process.returncode == 0, printed
    return printed


def test_two_boots_of_the_service_keep_one_map_without_twins(painted_bundle, tmp_path):
    text = UNIT.read_text()
    for folder in ("var/lib/edgemap", "var/cache/edgemap", "etc/edgemap", "home"):
        (tmp_path / folder).mkdir(parents=True)
        text = text.replace(f"/{folder}", str(tmp_path / folder))
    _, camera, *odometry = write_round(tmp_path, rounds=100)
    options = " ".join(map(str, ["--map", "home", "--bundle", painted_bundle, *odometry]))
    (tmp_path / "etc/edgemap/edgemap.conf").write_text(f"CAMERA={camera}\nMOUNT=1.0,0\nOPTIONS={options}\n")
    settings, state = read_unit(text), tmp_path / "var/lib/edgemap"
    printed = boot(settings, tmp_path / "first", tmp_path / "home")
    assert f"new map: {state}/maps/home/" in printed
    first = {item.id: item for item in load_map(state / "maps" / "home")}
    assert len(first) > 3
    printed = boot(settings, tmp_path / "second", tmp_path / "home")
    assert "found in home by" in printed
    second = {item.id: item for item in load_map(state / "maps" / "home")}
    assert [path.name for path in (state / "maps").iterdir()] == ["home"]
    assert len(list((state / "runs").iterdir())) == 2
    assert not list((tmp_path / "home").iterdir())  # all that is kept is in the service's own folders
    assert set(first) <= set(second)
    for name, item in first.items():
        assert second[name].count > item.count
        assert np.linalg.norm(second[name].position_m - item.position_m) < 0.3
    for one, other in combinations(second.values(), 2):
        assert one.label != other.label or np.linalg.norm(one.position_m - other.position_m) > 0.5


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
