"""Messages to systemd about a run that it supervises: `sd_notify` (3), a datagram to the socket in `$NOTIFY_SOCKET`."""

import os
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

BEATS = 4  # messages within the time that the watchdog allows


class ServiceNotifier:
    """Sends READY once, feeds the watchdog, and updates `systemctl status`; does nothing outside systemd.

    A manager that does not listen any more is no reason to end a run.
    """

    def __init__(
        self, environment: Mapping[str, str] = os.environ, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        allowed_us = environment.get("WATCHDOG_USEC", "")
        self._every_s = int(allowed_us) / 1e6 / BEATS if allowed_us.isdecimal() and ours else 0.0
        self._clock_s = clock_s
        self._sent_s = -1e9
        self._status = ""
        self._ready = False

    def beat(self, status: str) -> None:
        """Feed the watchdog. status: one line. The first call reports READY."""
        if not self._address:
            return
        lines = [] if self._ready else ["READY=1"]
        now_s = self._clock_s()
        due = now_s - self._sent_s >= (self._every_s or 1.0)
        if due and self._every_s:
            lines.append("WATCHDOG=1")
        if status != self._status and (due or not self._ready):
            lines.append(f"STATUS={status}")
            self._status = status
        if due or lines:
            self._sent_s = now_s if due else self._sent_s
            self._ready = True
            self._send(lines)

    def stopping(self) -> None:
        """The run ends and saves."""
        if self._address:
            self._send(["STOPPING=1"])

    def _send(self, lines: list[str]) -> None:
        if not lines:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.setblocking(False)
            sender.sendto("\n".join(lines).encode(), self._address)
