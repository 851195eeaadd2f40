"""Descriptions of options in the help."""

from typing import Any

import tyro


def arg(**options: Any) -> Any:
    """`tyro.conf.arg` that hides the defaults None, True and False: the help text itself describes them."""
    return tyro.conf.arg(help_behavior_hint=_default, **options)


def may_be_left_out(metavar: str, value: str) -> Any:
    """An option of type `str | None` whose value may be left out: `--option` alone means `value`."""

    def read(words: list[str]) -> str:
        if len(words) > 1:
            raise ValueError(f"takes one value at most, not {' '.join(words)}")
        return words[0] if words else value

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs="*",
        metavar=f"[{metavar}]",
        instance_from_str=read,
        is_instance=lambda given: given is None or isinstance(given, str),
        str_from_instance=lambda given: [] if given is None else [given],
    )


def _default(value: str) -> str:
    return "" if value in ("", "None", "True", "False") else f"(default: {value})"
