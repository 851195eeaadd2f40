"""Wrong usage in one line: what tyro draws as a box, in its own words."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable
from contextlib import redirect_stderr
from functools import wraps
from typing import Any

FRAME = re.compile(r"^[│╭╰─╮╯ ]?|[│╮╯]\s*$")


def parse_and_call(command: Callable[..., Any], words: str, rest: list[str]) -> None:
    """Call a command with what `rest` says. Wrong usage is one line on standard error, and exit code 2."""
    import tyro

    said, real = io.StringIO(), sys.stderr

    @wraps(command)
    def begun(*arguments: Any, **options: Any) -> Any:
        with redirect_stderr(real):
            return command(*arguments, **options)

    try:
        with redirect_stderr(said):
            tyro.cli(begun, prog=f"edgemap {words}", args=rest, config=(tyro.conf.FlagCreatePairsOff,))
    except SystemExit as error:
        if error.code == 2 and said.getvalue():
            from edgemap.runtime.reading import tell

            tell(f"edgemap {words}: {usage_line(said.getvalue())} (edgemap {words} --help)")
        raise


def usage_line(box: str) -> str:
    """The sentence in tyro's box, without the help text that it repeats."""
    lines = [FRAME.sub("", line).rstrip() for line in box.splitlines()[1:]]
    kept: list[str] = []
    for line in lines:
        if set(line.strip()) == {"─"} or line.strip() == "Got errors:":
            break
        if kept and line.startswith(" " * 9):  # what an option means, under its name
            continue
        kept.append(line)
    return " ".join(" ".join(kept).split()).replace("could be instantiated from", "can be made of").rstrip(".")
