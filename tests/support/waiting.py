"""What tests with other processes or threads need: a port of this machine, and patience that ends only in failures."""

import socket
import time


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def answers(port: int) -> bool:
    """Whether somebody listens there."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(condition, what: object = "", limit_s=60.0, pause_s=0.02):
    """Ask again until it is true; what it gave. what: for the failure, a text or what gives one."""
    until_s = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < until_s, what() if callable(what) else f"waited {limit_s:.0f} s for: {what}"
        time.sleep(pause_s)
    return value
