"""The run that a command means when it names none."""

from pathlib import Path

from edgemap.cli.errors import OptionError


def last_run() -> Path:
    """The newest run folder in `runs/`, by the time of its run.json. Raises OptionError where there is none."""
    found = [path for path in Path("runs").glob("*/run.json") if path.is_file()]
    if not found:
        raise OptionError("no run in runs/: give a map.json or a run folder, or make one with `edgemap run`")
    return max(found, key=lambda path: path.stat().st_mtime).parent
