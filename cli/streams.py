"""Standard streams of a command: closed ones, names that the locale cannot write, and a log whose disk is full."""

import errno
import os
import sys
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import Any

LOGGED = ("run", "record", "fleet serve")  # commands that write files: what they print is a log


class LossyLog(FileIO):
    """Drops what a full disk does not take, so that a run goes on without its log."""

    def write(self, data: Any) -> int:
        """Number of bytes written or dropped."""
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise
            return len(data)


def prepare_streams(words: str) -> None:
    """Makes the standard streams safe to write to. words: the command."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:  # a shell's `2>&-` leaves a number free that the next file opened would get, with all messages
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if not isinstance(stream, TextIOWrapper):
            continue
        if words.startswith(LOGGED) and stream is getattr(sys, f"__{name}__"):
            log = BufferedWriter(LossyLog(number, "w", closefd=False))
            setattr(sys, name, TextIOWrapper(log, stream.encoding, "backslashreplace", line_buffering=True))
        else:
            stream.reconfigure(errors="backslashreplace")  # names of files may hold what the locale cannot write
