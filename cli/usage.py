"""Wrong usage in one line: what tyro draws as a box, in its own words."""

import io
import re
import sys
from collections.abc import Callable
from contextlib import redirect_stderr
from dataclasses import is_dataclass
from functools import wraps
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from edgemap.cli.config_options import flags_of
from edgemap.runtime.frames.reading import print_message, user_path

NOT_OF_TYPE = re.compile(
    r"Error parsing (\S+): (?:no )?type matching (?:\{None\}\|)?(\S+) could be instantiated from \[(.*)\]"
)
SOURCE = re.compile(r"\S*[./:]\S*|\d+")  # a file, folder, address or number
STRAY_WORD = re.compile(r"Unrecognized options: ((?!-)\S+)")
FRAME = re.compile(r"^[│╭╰─╮╯ ]?|[│╮╯]\s*$")


def parse_and_call(command: Callable[..., Any], words: str, rest: list[str]) -> None:
    """Calls a command with the arguments `rest`. Wrong usage prints one line to standard error; exit code 2."""
    import tyro

    rest = [_from_home(word) for word in rest]
    captured, real = io.StringIO(), sys.stderr

    @wraps(command)
    def begun(*arguments: Any, **options: Any) -> Any:
        with redirect_stderr(real):
            return command(*arguments, **options)

    hints = get_type_hints(command, include_extras=True)
    begun.__annotations__ = {name: _spelt_out(hint) for name, hint in hints.items()}
    try:
        with redirect_stderr(captured):
            marks = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes)
            tyro.cli(begun, prog=f"edgemap {words}", args=rest, config=marks)
    except SystemExit as error:
        if error.code == 2 and captured.getvalue():
            line = usage_line(captured.getvalue(), "camera" in flags_of(command))
            print_message(f"edgemap {words}: {line} (edgemap {words} --help)")
        raise


def _from_home(word: str) -> str:
    """`~/x` and `--option=~/x` with the home folder, which a shell leaves out in the latter, a service in both."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + str(user_path(value)) if value.startswith("~/") else word


def _spelt_out(hint: Any) -> Any:
    """`A | B` as `Union[A, B]`, in the fields of a group of options too: of the former tyro asks typeguard, whose
    import takes as long as all the rest."""
    if is_dataclass(hint):
        fields = get_type_hints(hint, include_extras=True)
        hint.__annotations__ = {name: _spelt_out(field) for name, field in fields.items()}
        return hint
    if get_origin(hint) is Annotated:
        return Annotated[_spelt_out(hint.__origin__), *hint.__metadata__]
    return Union[get_args(hint)] if get_origin(hint) is UnionType else hint  # noqa: UP007


def usage_line(box: str, takes_camera: bool) -> str:
    """The sentence in tyro's box, without the help text that it repeats. takes_camera: whether there is --camera, for
    which a file or an address without an option was meant."""
    lines = [FRAME.sub("", line).rstrip() for line in box.splitlines()[1:]]
    kept: list[str] = []
    meant = [line.split()[0] for line in lines if line.startswith(" " * 5) and line.strip().startswith("--")]
    for line in lines:
        rule = set(line.strip()) in ({"─"}, {"-"})  # "-" where the output takes no box drawing: a Latin-1 terminal
        if rule and not kept:
            continue
        if rule or line.strip() == "Got errors:":
            break
        if kept and line.startswith(" " * 9):  # what an option means, under its name
            continue
        kept.append(line)
    sentence = " ".join(" ".join(kept).split()).rstrip(".")
    sentence = NOT_OF_TYPE.sub(r"\1: expected \2, not \3", sentence)
    stray = STRAY_WORD.fullmatch(sentence)
    if takes_camera and stray and (SOURCE.fullmatch(stray[1]) or Path(stray[1]).exists()):
        return f"{stray[1]}: no option; did you mean --camera {stray[1]}?"
    if not sentence.startswith("Unrecognized") or not meant:
        return sentence
    wrong = re.search(r"--[\w-]+", sentence)
    return f"{wrong[0] if wrong else sentence}: no such option; did you mean {meant[0]}?"
