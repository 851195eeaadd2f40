"""`--config FILE --config-options`: the options of a file as flags of `edgemap run`, each printed, and only then."""

import inspect
from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import is_dataclass
from typing import Any, get_type_hints

from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.reading import print_message, user_path, without_secrets

OWN = ("config", "config-options")
VALUE_MAY_LACK = object()  # default of an option such as --view: true in a file is the option alone


def config_arguments(argv: list[str], command: Callable[..., Any]) -> list[str]:
    """An argument list with the options of its `--config FILE` before the typed ones, which take precedence.

    Without `--config-options` a file sets tuned parameters only, and its options are reported as unused. command: whose
    flags they are. Raises UsageError for an option that the command does not have and for `--config-options` alone,
    ConfigError for the file.
    """
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config", nargs="?")
    path = parser.parse_known_args(argv)[0].config
    if path is None:
        if "--config-options" in argv:
            raise UsageError("--config-options: whose? Give the file, or a run's folder, with --config FILE")
        return argv
    from edgemap.runtime.step.config import load_options

    options = load_options(user_path(path))
    if "--config-options" not in argv:
        if options:
            named = ", ".join(str(name) for name in options)
            print_message(f"{path}: tuning only; its options ({named}) are used with --config-options")
        return argv
    flags = flags_of(command)
    words: list[str] = []
    for name, value in options.items():
        flag = str(name).replace("_", "-")
        if flag not in flags or flag in OWN:
            raise UsageError(f"{path}: options: {name} is not an option of edgemap run")
        default, spellings = flags[flag]
        if spellings & {word.partition("=")[0] for word in argv}:
            continue
        added = _words(flag, value, default, f"{path}: options: {name}")
        if added:
            print_message(f"{path} sets {' '.join(added)}")
        words += added
    return [*words, *argv]


def flags_of(command: Callable[..., Any]) -> dict[str, tuple[Any, set[str]]]:
    """A command's flags without dashes, those in groups of options too: the default, and all ways to type it."""
    from tyro.constructors import PrimitiveConstructorSpec

    hints = get_type_hints(command, include_extras=True)
    flags: dict[str, tuple[Any, set[str]]] = {}
    for parameter, described in inspect.signature(command).parameters.items():
        hint = hints[parameter]
        group = getattr(hint, "__origin__", hint)
        if is_dataclass(group):
            flags |= flags_of(group)  # type: ignore[arg-type]
            continue
        marks = getattr(hint, "__metadata__", ())
        flag = next((name for one in marks if (name := getattr(one, "name", None))), parameter.replace("_", "-"))
        aliases = {alias for one in marks for alias in getattr(one, "aliases", None) or ()}
        bare = any(isinstance(one, PrimitiveConstructorSpec) for one in marks)
        flags[flag] = (VALUE_MAY_LACK if bare else described.default, {f"--{flag}", f"--no-{flag}", *aliases})
    return flags


def _words(flag: str, value: Any, default: Any, where: str) -> list[str]:
    """One option as typed: a switch that stands as it does anyway needs no word."""
    if value is None:
        return []
    if default is VALUE_MAY_LACK and isinstance(value, bool):
        return [f"--{flag}"] if value else []
    if isinstance(default, bool) != isinstance(value, bool):
        raise UsageError(f"{where} is {value!r}, not {'true or false' if isinstance(default, bool) else 'a value'}")
    if isinstance(value, bool):
        return [] if value is default else [f"--{flag}" if value else f"--no-{flag}"]
    if isinstance(value, str) and "***" in without_secrets(value):
        raise UsageError(f"{where}: its password is not recorded: type --{flag} again")
    if not isinstance(value, str | int | float) or not str(value).isprintable():
        raise UsageError(f"{where} is not one printable value")
    return [f"--{flag}", str(value)]
