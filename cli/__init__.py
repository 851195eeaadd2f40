"""The command line: finds the command, parses its arguments, and only then imports what it needs."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import NoReturn

# Command words to (module, one line). Each module has a function `command` whose signature is its arguments.
COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("run", "drive: camera to map, live or from files; writes a run folder"),
    "detect": ("detect", "boxes and floor distances in single pictures"),
    "bench": ("bench", "frames per second and latency, stage by stage, on this processor"),
    "pull": ("pull", "fetch a known model, or a finished bundle, into the cache"),
    "export": ("export", "trained weights to a bundle that the robot loads (host, extra 'export')"),
    "train odometry": ("train_odometry", "drives with true poses to an odometry head (host, extra 'export')"),
    "train detector": ("train_detector", "labelled pictures to a small detector's weights (host, extra 'export')"),
    "eval detection": ("eval_detection", "average precision on labelled pictures"),
    "eval odometry": ("eval_odometry", "drift of the robot's own motion against true poses"),
    "eval map": ("eval_map", "mapped objects against the true ones: F1, errors, consistency"),
    "map show": ("map_show", "draw a map: all sightings, clusters, centres"),
    "map export": ("map_export", "a map for other programs: GeoJSON, Nav2, CSV, picture"),
    "map merge": ("map_merge", "maps of one place become one, aligned by their objects"),
    "fleet serve": ("fleet_serve", "keep one map of a place from the maps of many robots"),
    "fleet show": ("fleet_show", "a fleet's merged map, its robots and where they are"),
    "record": ("record", "a camera's pictures into one MCAP file; Foxglove and ROS 2 open it"),
    "simulate": ("simulate", "render a robot's drive through a furnished home, with its truth"),
    "calibrate intrinsics": ("calibrate_intrinsics", "the lens, from pictures of a chessboard"),
    "calibrate mount": (
        "calibrate_mount",
        "height, pitch and roll: floor in depth pictures, edges and wheels, or a board",
    ),
    "calibrate tilt": ("calibrate_tilt", "pitch and roll without a pattern, from the room's own edges"),
    "cameras": ("cameras", "the cameras that are here, and what to type for each"),
    "doctor": ("doctor", "what works on this machine, what is missing, what to type"),
}

USAGE = "usage: edgemap COMMAND [OPTIONS]      (edgemap COMMAND --help lists a command's options)"


def overview() -> str:
    """What `edgemap --help` prints."""
    lines = [USAGE, "", "A 2-D map of the objects on the floor from one camera, on a CPU.", ""]
    lines += [f"  {words:<22}{text}" for words, (_, text) in COMMANDS.items()]
    lines += ["", "First steps:  edgemap run                  the demo drive, ends with a map in runs/"]
    lines += ["              edgemap doctor               checks camera, libraries, bundle and mount"]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 0; 2 for wrong usage; 1 for a known failure (one line), 3 camera lost, 4 disk."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads would wait in circles
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] in ("-h", "--help"):
        print(overview())
        sys.exit(0 if arguments else 2)
    if arguments[0] == "--version":
        from edgemap import __version__

        print(f"edgemap {__version__}")
        return
    words = next((words for words in (" ".join(arguments[:2]), arguments[0]) if words in COMMANDS), None)
    if words is None:
        known = sorted(COMMANDS)
        if any(name.startswith(arguments[0] + " ") for name in known):
            known = [name for name in known if name.startswith(arguments[0] + " ")]
        asked_help = arguments[-1] in ("-h", "--help") and known != sorted(COMMANDS)
        text = f"edgemap: {' '.join(arguments[:2])!r} is not a command; there are: {', '.join(known)}"
        print(overview() if asked_help else text, file=sys.stdout if asked_help else sys.stderr)
        sys.exit(0 if asked_help else 2)
    _run(words, arguments[len(words.split()) :])


def _run(words: str, rest: list[str]) -> None:
    try:
        from edgemap.cli.interrupt import interrupts_after_imports

        with interrupts_after_imports():
            _command(words, rest)
    except KeyboardInterrupt:
        print(f"edgemap {words}: interrupted", file=sys.stderr)
        sys.exit(130)


def _command(words: str, rest: list[str]) -> None:
    from edgemap.cli.usage import parse_and_call
    from edgemap.geometry.errors import EdgemapError

    try:
        command = import_module(f"edgemap.cli.{COMMANDS[words][0]}").command
        if words == "run" and any(word.partition("=")[0] == "--config" for word in rest):
            from edgemap.runtime.config import config_arguments

            rest = config_arguments(rest)
        parse_and_call(command, words, rest)
    except EdgemapError as error:
        _end(f"edgemap {words}: {error}", error.exit_code)
    except BrokenPipeError:  # `edgemap ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # a path that the system refuses: too long, not allowed
        where = f"{error.filename}: " if error.filename else ""
        _end(f"edgemap {words}: {where}{error.strerror or error}", 1)


def _end(message: str, exit_code: int) -> NoReturn:
    from edgemap.runtime.reading import print_message

    print_message(message)
    sys.exit(exit_code)
