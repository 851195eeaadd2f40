"""The command line: selects the command, parses its arguments, and imports its modules only then."""

import os
import sys
from collections.abc import Callable
from importlib import import_module
from typing import NoReturn

from edgemap.cli.streams import prepare_streams

# Command words to (module, one line). Each module has a function `command` whose signature is its arguments.
COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("run", "drive: camera to map, live or from files; writes a run folder"),
    "why": ("why", "how far a run's map can be trusted, and what to do about it"),
    "detect": ("detect", "boxes and floor distances in single pictures"),
    "bench": ("bench", "frames per second and latency, stage by stage, on this processor"),
    "pull": ("pull", "fetch a known model, or a finished bundle, into the cache"),
    "export": ("export", "trained weights to a bundle that the robot loads (host, extra 'export')"),
    "train odometry": ("train_odometry", "drives with true poses to an odometry head (host, extra 'export')"),
    "train detector": ("train_detector", "labelled pictures to a small detector's weights (host, extra 'export')"),
    "train floor": ("train_floor", "pictures with floor labels to a floor head (host, extra 'export')"),
    "eval detection": ("eval_detection", "average precision on labelled pictures"),
    "eval odometry": ("eval_odometry", "drift of the robot's own motion against true poses"),
    "eval floor": ("eval_floor", "overlap and contact error of the floor mask on labelled pictures"),
    "eval map": ("eval_map", "mapped objects against the true ones: F1, errors, consistency"),
    "map show": ("map_show", "draw a map: all sightings, clusters, centres"),
    "map export": ("map_export", "a map for other programs: GeoJSON, Nav2, CSV, picture"),
    "map approach": ("map_approach", "where a robot goes to reach an object: a free pose that faces it"),
    "map scale": ("map_scale", "a map of a camera alone, scaled by one measured length"),
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

GROUP = "edgemap.commands"  # entry points: our bridges', and those of other packages
BRIDGES = {"mcp": "the map for language agents: a Model Context Protocol server (extra 'mcp')"}
USAGE = "usage: edgemap COMMAND [OPTIONS]      (edgemap COMMAND --help lists a command's options)"


def overview() -> str:
    """The text of `edgemap --help`."""
    lines = [USAGE, "", "A 2-D map of the objects on the floor from one camera, on a CPU.", ""]
    lines += [f"  {words:<22}{text}" for words, (_, text) in COMMANDS.items()]
    lines += [f"  {name:<22}{text}" for name, text in (BRIDGES | plugin_commands()).items()]
    lines += ["", "First steps:  edgemap run                  the demo drive, ends with a map in runs/"]
    lines += ["              edgemap run --camera 0 --mount 0.60    a webcam 0.60 m above the floor"]
    lines += ["              edgemap doctor               checks camera, libraries, bundle and mount"]
    return "\n".join(lines)


def plugin_commands() -> dict[str, str]:
    """Commands of other packages (entry points `edgemap.commands`), each with its package; nothing is imported."""
    from edgemap.geometry.errors import EdgemapError
    from edgemap.runtime.frames.plugins import package_of, plugins

    taken = {*COMMANDS, *BRIDGES}
    try:
        found = plugins(GROUP)
    except EdgemapError as error:
        return {"": str(error)}
    return {name: f"of the package {package_of(point)}" for name, point in found.items() if name not in taken}


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 0; 2 for wrong usage; 1 for an EdgemapError (one line); 3 where the camera is lost; 4 for
    the disk.
    """
    try:
        _main(sys.argv[1:] if arguments is None else arguments)
    except MemoryError:
        _end("edgemap: not enough memory", 1)
    except BrokenPipeError:  # `edgemap ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # a full disk behind standard output
        _end(f"edgemap: {error.strerror or error}", 1)


def _main(arguments: list[str]) -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads would wait in circles
    prepare_streams(" ".join(arguments[:2]))
    if not arguments or arguments[0] in ("-h", "--help"):
        print(overview())
        sys.exit(0 if arguments else 2)
    if arguments[0] == "--version":
        from edgemap import __version__

        print(f"edgemap {__version__}")
        return
    words = next((words for words in (" ".join(arguments[:2]), arguments[0]) if words in COMMANDS), None)
    if words is None and (arguments[0] in BRIDGES or arguments[0] in plugin_commands()):
        words = arguments[0]
    if words is None:
        _no_command(arguments)
    _run(words, arguments[len(words.split()) :])


def _no_command(arguments: list[str]) -> NoReturn:
    """Help for a group's name alone (`edgemap map`); for anything else one line with what may be meant."""
    group = {words: text for words, (_, text) in COMMANDS.items() if words.startswith(arguments[0] + " ")}
    if group and (len(arguments) == 1 or arguments[1] in ("-h", "--help")):
        lines = [f"usage: edgemap {arguments[0]} COMMAND [OPTIONS]", ""]
        print("\n".join([*lines, *(f"  {words:<22}{text}" for words, text in group.items())]))
        sys.exit(2 if len(arguments) == 1 else 0)
    from difflib import get_close_matches

    typed = " ".join(arguments[: 2 if group else 1])
    known = [*COMMANDS, *BRIDGES, *({words.split()[0] for words in COMMANDS} - set(COMMANDS))]
    close = get_close_matches(typed, list(group) or known, 1, 0.6)
    hint = f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(sorted(group or COMMANDS))}"
    _end(f"edgemap: {typed!r} is not a command; {hint} (edgemap --help)", 2)


def _run(words: str, rest: list[str]) -> None:
    """Runs a command. Ctrl-C ends it in one line, also where a library turns that into an error of its own."""
    import signal
    from threading import current_thread, main_thread

    interrupted: list[int] = []

    def interrupt(number: int, frame: object) -> None:  # noqa: ARG001
        interrupted.append(number)
        raise KeyboardInterrupt

    if current_thread() is main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        _command(words, rest)
    except (Exception, KeyboardInterrupt) as error:
        if not interrupted and not isinstance(error, KeyboardInterrupt):
            raise
        print(f"edgemap {words}: interrupted", file=sys.stderr)
        sys.exit(130)
    finally:
        if signal.getsignal(signal.SIGINT) is interrupt:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _command(words: str, rest: list[str]) -> None:
    from edgemap.cli.usage import parse_and_call
    from edgemap.geometry.errors import EdgemapError

    try:
        command = _imported(words)
        if words == "run" and any(word.partition("=")[0] in ("--config", "--config-options") for word in rest):
            from edgemap.cli.config_options import config_arguments

            rest = config_arguments(rest, command)
        parse_and_call(command, words, rest)
    except EdgemapError as error:
        _end(f"edgemap {words}: {error}", error.exit_code)
    except UnicodeEncodeError as error:  # half a character in a name, where a library wants a text
        _end(f"edgemap {words}: {error.object!r} is not UTF-8", 1)
    except BrokenPipeError:
        raise
    except OSError as error:  # a path that the system refuses: too long, not allowed
        where = f"{error.filename}: " if error.filename else ""
        _end(f"edgemap {words}: {where}{error.strerror or error}", 1)


def _imported(words: str) -> Callable[..., None]:
    """The function of a command. Raises PluginError for one of another package that does not load."""
    if words in COMMANDS:
        return import_module(f"edgemap.cli.{COMMANDS[words][0]}").command
    from edgemap.runtime.frames.errors import PluginError
    from edgemap.runtime.frames.plugins import load_plugin, plugins

    found = plugins(GROUP)
    if words not in found:
        raise PluginError("it is not registered: install edgemap again (in a checkout: pip install -e .)")
    return load_plugin(found[words])


def _end(message: str, exit_code: int) -> NoReturn:
    from edgemap.runtime.frames.reading import print_message

    print_message(message)
    sys.exit(exit_code)
