"""Strategies of valid documents with something wrong in them: most get past the first parse."""

import json
import math
import os
from contextlib import suppress
from copy import deepcopy
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CameraFault

MUTATED = settings(
    max_examples=int(os.environ.get("EDGEMAP_EXAMPLES", "15")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large],
)
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 255, 1 << 31, 1 << 63, -(1 << 63), 10**400, -0.0, 1e-320, 1e9, 1e308, -1e308,
    math.nan, math.inf, -math.inf, "", "chair", "nan", "1e999", "../../etc/passwd", "a\0b", "a\nb\x1b[2J",
    "\u2028\u202e", "\ud800", "9" * 5000, [], {}, [[]], [1.0, 2.0, 3.0], {"": 0}, {"a": {"b": [1]}},
)  # fmt: skip
WORDS = (
    "nan", "inf", "1e999", "-1e308", "1e-320", "-0", "1000001", "1e12", "0x10", "1_0", "", "x", "--1", "1,1",
    "9" * 5000, "٣", "\0", "1;2", "#", "=", "[", "[net]", "x" * 5000, "0 0 0",
)  # fmt: skip
BYTES = (b"\0", b"\xff", b"\n", b"{", b'"', b"\xff\xff\xff\xff", b"\0" * 8, b"-", b"\x7f" * 8, b"9" * 400)
NESTS = (30, 900, 30_000)


def refused_or(read: Any, *arguments: Any) -> Any:
    """What a reader gives; None where it refuses with one printable line of an EdgemapError."""
    try:
        return read(*arguments)
    except EdgemapError as error:
        text = str(error)
        assert text.splitlines() == [text]
        assert text.isprintable()
        assert len(text) < 1000
        return None


def drained(camera: Camera) -> None:
    """Reads at most fifty frames and closes the camera; faults are what a run continues after."""
    last_s = -math.inf
    with camera:
        for _ in range(50):
            with suppress(CameraFault):
                if (frame := camera.read()) is None:
                    return
                assert frame.image.dtype == np.uint8
                assert frame.stamp_s >= last_s
                last_s = frame.stamp_s


def _places(tree: Any, path: tuple = ()) -> list[tuple]:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [place for key, value in items for place in ((*path, key), *_places(value, (*path, key)))]


@st.composite
def mutated_tree(draw: Any, tree: Any) -> Any:
    """A tree of dicts and lists with one to three values replaced, scaled, repeated, added or missing."""
    tree = deepcopy(tree)
    for _ in range(draw(st.integers(1, 3))):
        if not (places := _places(tree)):
            break
        *path, key = draw(st.sampled_from(places))
        holder: Any = reduce(getitem, path, tree)
        how = draw(st.sampled_from(("replace", "replace", "scale", "remove", "repeat")))
        if how == "remove":
            del holder[key]
        elif how == "repeat" and isinstance(holder, list):
            holder.insert(draw(st.integers(0, len(holder))), deepcopy(holder[key]))
        elif how == "repeat":
            holder[draw(st.sampled_from(("extra", "id", "x")))] = deepcopy(holder[key])
        elif how == "scale" and type(holder[key]) in (int, float):
            with suppress(OverflowError, ValueError):  # of what is huge or NaN already
                holder[key] = type(holder[key])(holder[key] * draw(st.sampled_from((-1, 0.5, 10, 1e6, 1.0 + 1e-9))))
        else:
            holder[key] = deepcopy(draw(st.sampled_from(VALUES)))
    return tree


@st.composite
def mutated_bytes(draw: Any, valid: bytes) -> bytes:
    """Bytes flipped, overwritten, cut off, removed, repeated or put in."""
    data = bytearray(valid)
    for _ in range(draw(st.integers(1, 4))):
        if not data:
            break
        at = draw(st.integers(0, len(data) - 1))
        how = draw(st.sampled_from(("flip", "flip", "set", "set", "put", "remove", "repeat", "cut")))
        if how == "flip":
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "cut":
            del data[at:]
        elif how == "remove":
            del data[at : at + draw(st.sampled_from((1, 4, 100)))]
        elif how == "repeat":
            data[at:at] = data[at : at + draw(st.sampled_from((1, 8, 1000)))]
        else:
            new = draw(st.sampled_from(BYTES))
            data[at : at + len(new) * (how == "set")] = new
    return bytes(data)


@st.composite
def mutated_json(draw: Any, tree: Any) -> bytes:
    """A mutated tree as JSON, now and then with a deep nest or damaged bytes in it."""
    text = json.dumps(draw(mutated_tree(tree)), ensure_ascii=draw(st.booleans()))
    how = draw(st.sampled_from(("tree", "tree", "tree", "tree", "nest", "bytes")))
    if how == "nest":
        depth = draw(st.sampled_from(NESTS))
        text = text.replace(draw(st.sampled_from((": ", ", "))), f": {'[' * depth}{']' * depth}, ", 1)
    data = text.encode(errors="surrogatepass")
    return draw(mutated_bytes(data)) if how == "bytes" else data


@st.composite
def mutated_rows(draw: Any, text: str) -> bytes:
    """A text table with words or lines changed, lines missing or repeated, or damaged bytes in it."""
    if draw(st.integers(0, 7)) == 0:
        return draw(mutated_bytes(text.encode()))
    lines = text.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        how = draw(st.sampled_from(("word", "word", "word", "remove", "repeat", "add")))
        if how == "remove" and len(lines) > 1:
            del lines[at]
        elif how == "repeat":
            lines.insert(at, draw(st.sampled_from(lines)))
        elif how == "add":
            lines.insert(at, draw(st.sampled_from(WORDS)))
        else:
            separator = "," if "," in lines[at] else "=" if "=" in lines[at] else " "
            words = lines[at].split(separator)
            words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(WORDS))
            lines[at] = separator.join(words)
    return "\n".join(lines).encode()


@st.composite
def mutated_lines(draw: Any, records: list[Any]) -> bytes:
    """A file of one JSON record on each line, one of them mutated."""
    chosen = draw(st.integers(0, len(records) - 1))
    lines = [json.dumps(record).encode() for record in records]
    lines[chosen] = draw(mutated_json(records[chosen]))
    return b"\n".join(lines) + b"\n" * draw(st.integers(0, 1))
