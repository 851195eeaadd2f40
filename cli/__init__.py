"""The command line: selects the command, parses its arguments, and imports its modules only then."""

import os
import signal
import sys
from importlib import import_module
from threading import current_thread, main_thread
from typing import NoReturn

from edgemap.cli.streams import prepare_streams
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import PluginError, UsageError
from edgemap.runtime.frames.reading import print_message
from edgemap.runtime.frames.version import VERSION

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
    from edgemap.runtime.frames.plugins import package_of, plugins

    taken = {*COMMANDS, *BRIDGES}
    try:
        found = plugins(GROUP)
    except EdgemapError as error:
        return {"": str(error)}
    return {name: f"of the package {package_of(point)}" for name, point in found.items() if name not in taken}


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exit code 0; 2 for wrong usage; 1 for an EdgemapError (one line); 3 where the camera is lost; 4 for
    the disk; 130 for Ctrl-C, also where a library turns that into an error of its own.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    name, interrupted = "edgemap", list[int]()

    def interrupt(number: int, frame: object) -> None:  # noqa: ARG001
        interrupted.append(number)
        raise KeyboardInterrupt

    if ours := current_thread() is main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads would wait in circles
        prepare_streams(" ".join(arguments[:2]))
        if not arguments or arguments[0] in ("-h", "--help"):
            print(overview())
            sys.exit(0 if arguments else 2)
        if arguments[0] == "--version":
            print(f"edgemap {VERSION}")
            return
        words = _words_of(arguments)
        name = f"edgemap {words}"
        _command(words, arguments[len(words.split()) :])
    except EdgemapError as error:
        _end(f"{name}: {error}", error.exit_code)
    except UnicodeEncodeError as error:  # half a character in a name, where a library wants a text
        _end(f"{name}: {error.object!r} is not UTF-8", 1)
    except BrokenPipeError:  # `edgemap ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # a path that the system refuses: too long, not allowed; a full disk behind the output
        where = f"{error.filename}: " if error.filename else ""
        _end(f"{name}: {where}{error.strerror or error}", 1)
    except MemoryError:
        _end("edgemap: not enough memory", 1)
    except (Exception, KeyboardInterrupt) as error:
        if not interrupted and not isinstance(error, KeyboardInterrupt):
            raise
        _end(f"{name}: interrupted", 130)
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _words_of(arguments: list[str]) -> str:
    """The words of the command. Ends with help for a group's name alone (`edgemap map`). Raises UsageError for anything
    else, with what may be meant."""
    for words in (" ".join(arguments[:2]), arguments[0]):
        if words in COMMANDS:
            return words
    if arguments[0] in BRIDGES or arguments[0] in plugin_commands():
        return arguments[0]
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
    raise UsageError(f"{typed!r} is not a command; {hint} (edgemap --help)")


def _command(words: str, rest: list[str]) -> None:
    """Runs a command. Raises PluginError for one of another package that does not load."""
    from edgemap.cli.usage import parse_and_call

    if words in COMMANDS:
        command = import_module(f"edgemap.cli.{COMMANDS[words][0]}").command
    else:
        from edgemap.runtime.frames.plugins import load_plugin, plugins

        found = plugins(GROUP)
        if words not in found:
            raise PluginError("it is not registered: install edgemap again (in a checkout: pip install -e .)")
        command = load_plugin(found[words])
    if words == "run" and any(word.partition("=")[0] in ("--config", "--config-options") for word in rest):
        from edgemap.cli.config_options import config_arguments

        rest = config_arguments(rest, command)
    parse_and_call(command, words, rest)


def _end(message: str, exit_code: int) -> NoReturn:
    print_message(message)
    sys.exit(exit_code)
