"""`edgemap run` with its live page, in a process of its own."""

import subprocess
import sys


def begin_live_run(*arguments: str, stderr: int | None = None) -> subprocess.Popen[str]:
    """`edgemap run --view` on a free port; the first line of its standard output ends with the page's address."""
    command = [sys.executable, "-u", "-m", "edgemap.cli", "run", "--view", "127.0.0.1:0", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True)
