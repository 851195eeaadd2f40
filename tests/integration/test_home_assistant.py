"""`make integration`: Home Assistant 2024.3.3, with its own Python, discovers a robot that `edgemap run` maps with."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from support.broker import MISSING, Broker

ROOT = Path(__file__).parents[2]
PYTHON = Path(os.environ.get("EDGEMAP_HOME_ASSISTANT", ROOT / ".home-assistant/bin/python"))
PATIENCE_S = 240.0

if not os.environ.get("EDGEMAP_INTEGRATION"):
    pytest.skip("real counterparts: make integration", allow_module_level=True)
pytestmark = [
    pytest.mark.skipif(bool(MISSING), reason=f"not here: {', '.join(MISSING)} (apt install mosquitto …-clients)"),
    pytest.mark.skipif(not PYTHON.exists(), reason=f"Home Assistant could not be installed: no {PYTHON}"),
]


class HomeAssistant:
    """The program, and what it has shown so far: lists of entity (or `device`), state and attributes."""

    def __init__(self, folder, port):
        script = ROOT / "tests/support/home_assistant.py"
        self._log = (folder / "home-assistant.log").open("w")
        command = [PYTHON, script, folder / "home-assistant", str(port)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self._log, text=True)
        self.shown = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        self.shown.extend(json.loads(line) for line in self.process.stdout if line.startswith("["))

    def until(self, entity, true, after=0):
        """Wait until it shows a state of an entity that is as wanted; how much had been shown then."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            if any(name == entity and true(state, attributes) for name, state, attributes in self.shown[after:]):
                return len(self.shown)
            time.sleep(0.2)
        raise AssertionError(f"{entity}: {[one for one in self.shown if one[0] == entity][-3:]}")

    def close(self):
        self.process.kill()
        self.process.wait()
        self._log.close()


def test_home_assistant_shows_the_robot_its_objects_events_and_that_it_is_gone(tmp_path):
    broker = Broker(tmp_path)
    home = HomeAssistant(tmp_path, broker.port)
    robot = None
    try:
        home.until("ready", lambda *_: True)
        words = ["run", "--frames", "150", "--threads", "1", "--mqtt", f"127.0.0.1:{broker.port}"]
        command = [sys.executable, "-m", "edgemap.cli", *words, "--out", tmp_path / "run"]
        robot = subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, "EDGEMAP_ROBOT": "robo"})
        home.until("device", lambda name, more: name == "robo" and more == {"manufacturer": "edgemap"})
        appeared = {"event_type": "appeared", "label": "chair"}
        home.until("event.robo_changes", lambda _, more: appeared.items() <= more.items())
        home.until("sensor.robo_objects", lambda state, _: state.isdigit() and int(state) >= 3)
        home.until("image.robo_map_picture", lambda state, more: "entity_picture" in more and state[:2] == "20")
        home.until("binary_sensor.robo_camera", lambda on, more: (on, more["device_class"]) == ("on", "connectivity"))
        home.until("binary_sensor.robo_map", lambda state, more: state in ("on", "off") and "level" in more)
        for button in ("save_map", "relocalise_in_dock"):
            home.until(f"button.robo_{button}", lambda state, _: state == "unknown")
        home.until("sensor.robo_room", lambda state, _: state != "unavailable")
        shown = home.until("sensor.robo_x", lambda state, more: more["unit_of_measurement"] == "m" and "." in state)
        assert robot.wait(PATIENCE_S) == 0
        for entity in ("sensor.robo_objects", "sensor.robo_last_fault", "event.robo_changes"):
            home.until(entity, lambda state, _: state == "unavailable", shown)
    finally:
        if robot is not None and robot.returncode is None:
            robot.kill()
            robot.wait()
        home.close()
        broker.stop()
