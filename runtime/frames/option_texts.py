"""Texts of options that plugins read as the command line does: addresses, numbers, NAME=VALUE words, names."""

import math
from collections.abc import Iterable
from typing import Literal

from edgemap.runtime.frames.errors import UsageError

Clustering = Literal["default", "paper"]


def host_and_port(text: str, option: str, port: int) -> tuple[str, int]:
    """`HOST`, `HOST:PORT` or `[IPv6]:PORT`. port: the default. Raises UsageError."""
    if "@" in text:
        raise UsageError(f"{option}: expected HOST or HOST:PORT; user and password come from the environment")
    host, colon, digits = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, digits = text, str(port)
    host = host.removeprefix("[").removesuffix("]")
    if not host or not digits.isdecimal() or len(digits) > 5 or int(digits) > 65535:
        raise UsageError(f"{option} {text!r}: expected HOST or HOST:PORT with a port of 0 to 65535")
    try:
        host.encode("idna")  # as every connection does, on a thread of its own
    except UnicodeError as error:
        raise UsageError(f"{option} {text!r}: no name of a host ({error})") from None
    return host, int(digits)


def words_of(text: str, option: str, names: set[str]) -> dict[str, str]:
    """`NAME=VALUE,NAME=VALUE`. names: those allowed. Raises UsageError."""
    words: dict[str, str] = {}
    for word in filter(None, text.split(",")):
        name, _, value = (part.strip() for part in word.partition("="))
        if name not in names or name in words or not value:
            raise UsageError(f"{option} {word!r}: expected NAME=VALUE once each, with {', '.join(sorted(names))}")
        words[name] = value
    return words


def numbers(text: str, option: str, names: str) -> list[float]:
    """Comma-separated finite numbers, as many as there are names. Raises UsageError."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(names.split(",")):
        raise UsageError(f"{option} {text!r}: expected {len(names.split(','))} numbers, {names}")
    if not all(map(math.isfinite, values)):
        raise UsageError(f"{option} {text!r}: {names} must be finite numbers")
    return values


def known_names(unknown: Iterable[str], known: Iterable[str], whose: str) -> str:
    """A hint for unknown names: similar valid names, or else all valid ones."""
    from difflib import get_close_matches

    names = sorted(set(known))
    lower = {name.casefold(): name for name in names}
    meant = [lower[close[0]] for name in unknown if (close := get_close_matches(name.casefold(), lower, 1, 0.75))]
    return f"did you mean {', '.join(meant)}?" if meant else f"{whose} {', '.join(names) or 'none'}"
