"""A real MQTT broker (mosquitto) on this machine, and its own client to read what is published."""

import shutil
import subprocess
import time
from typing import Any

from support.waiting import answers, free_port, wait_for

PATH = "/usr/sbin:/usr/bin:/usr/local/bin"  # Debian keeps the broker where only root's shell looks
READY = "ready"  # a retained topic of the tests' own
MISSING = [name for name in ("mosquitto", "mosquitto_pub", "mosquitto_sub") if shutil.which(name, path=PATH) is None]


class Broker:
    """mosquitto on a port of its own, until `stop`; `start` takes the same port. Retained messages go with it."""

    def __init__(self, folder):
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
        self._process = None
        self.start()

    def start(self):
        command = [shutil.which("mosquitto", path=PATH), "-c", str(self._config)]
        self._process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        wait_for(lambda: answers(self.port), "mosquitto")
        address = ["-h", "127.0.0.1", "-p", str(self.port)]
        subprocess.run(["mosquitto_pub", *address, "-t", READY, "-m", "yes", "-r"], check=True)

    def stop(self):
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
            self._process = None

    def retained(self, topic="#", until=lambda told: True):
        """Topic to payload of what a newcomer is told, once that is as `until` wants it: publishers do not wait."""
        until_s = time.monotonic() + 60
        while True:
            lines = self._read("-t", topic, "-t", READY, "--retained-only", "-W", "1").splitlines()
            told = dict(line.split("\t", 1) for line in lines)
            heard = told.pop(READY, None)  # else the reader was not served within its second
            if (heard and until(told)) or time.monotonic() > until_s:
                return told

    def publish(self, topic, payload):
        """One message, not retained."""
        address = ["-h", "127.0.0.1", "-p", str(self.port)]
        subprocess.run(["mosquitto_pub", *address, "-t", topic, "-m", payload], check=True)

    def listen(self, topic) -> Any:
        """A process that prints one `topic<TAB>payload` line a message, once it is subscribed."""
        address = ["-h", "127.0.0.1", "-p", str(self.port)]
        command = ["mosquitto_sub", *address, "-t", READY, "-t", topic, "-F", "%t\t%p"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == f"{READY}\tyes\n"
        return process

    def _read(self, *options):
        command = ["mosquitto_sub", "-h", "127.0.0.1", "-p", str(self.port), "-F", "%t\t%p", *options]
        return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False).stdout
