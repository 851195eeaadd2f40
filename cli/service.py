"""Messages to systemd about a run that it supervises: `sd_notify` (3), a datagram to the socket in `$NOTIFY_SOCKET`."""

import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress

BEATS = 4  # messages within the time that the watchdog allows


class ServiceNotifier:
    """Sends READY once, feeds the watchdog, and updates `systemctl status`; does nothing outside systemd.

    A manager that does not listen any more is no reason to end a run.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        allowed_us = environment.get("WATCHDOG_USEC", "")
        self._fed = ours and allowed_us.isdecimal()
        self._every_s = int(allowed_us) / 1e6 / BEATS if self._fed else 1.0
        self._sent_s = -1e9

    def beat(self, status: str) -> None:
        """Feed the watchdog, where it is due. status: one line. The first call reports READY."""
        if time.monotonic() - self._sent_s >= self._every_s:
            self._sent_s = time.monotonic()
            self._send("READY=1", *["WATCHDOG=1"] * self._fed, f"STATUS={status}")

    def stopping(self) -> None:
        """The run ends and saves."""
        self._send("STOPPING=1")

    def _send(self, *lines: str) -> None:
        if not self._address:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.setblocking(False)
            sender.sendto("\n".join(lines).encode(), self._address)
