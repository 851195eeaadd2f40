"""How long a process takes to end when it is asked to, whatever else the machine does meanwhile."""

import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

POLL_S = 0.002


@dataclass(frozen=True)
class Ending:
    """own_s: from the signal to the end, less the longest time that one of its threads was ready to run and had no
    processor (the kernel's count): on a machine that has its cores to itself, the time by the clock. busy_s: processor
    time of all threads meanwhile."""

    code: int
    output: str
    errors: str
    own_s: float
    busy_s: float


def ended_by_sigterm(run: subprocess.Popen[str], limit_s: float = 120.0) -> Ending:
    """Send SIGTERM and follow every thread to the end of the process."""
    before, seen = _threads(run.pid), {}
    asked_s = time.monotonic()
    run.send_signal(signal.SIGTERM)
    while run.poll() is None and time.monotonic() - asked_s < limit_s:
        seen |= _threads(run.pid)
        time.sleep(POLL_S)
    took_s = time.monotonic() - asked_s
    output, errors = run.communicate(timeout=120)
    used = [(now[0] - then[0], now[1] - then[1]) for now, then in ((seen[t], before.get(t, (0.0, 0.0))) for t in seen)]
    waited_s = max((waited for _, waited in used), default=0.0)
    return Ending(run.returncode, output, errors, took_s - waited_s, sum(busy for busy, _ in used))


def _threads(pid: int) -> dict[str, tuple[float, float]]:
    """By thread: seconds on a processor, and ready but waiting for one."""
    found = {}
    for task in Path(f"/proc/{pid}/task").glob("*"):
        try:
            running_ns, waiting_ns, _ = (task / "schedstat").read_text().split()
        except (OSError, ValueError):  # it has ended meanwhile
            continue
        found[task.name] = (int(running_ns) / 1e9, int(waiting_ns) / 1e9)
    return found
