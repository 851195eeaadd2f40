"""Seeded mutations of valid documents: values, structure and bytes, so that most of them get past the first parse."""

import json
import struct
from contextlib import suppress
from copy import deepcopy
from random import Random
from typing import Any

HUGE = 10**400
NASTY: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 7, 255, 256, 65536, 1 << 31, (1 << 31) - 1, 1 << 63, -(1 << 63), 1 << 64, HUGE,
    0.0, -0.0, 0.5, 1.5, 1e-9, 1e-320, 1e9, 1e300, -1e300, float("nan"), float("inf"), float("-inf"),
    "", "x", "chair", "none", "0", "1e999", "nan", "../../etc/passwd", "/tmp/x", "a\0b", "a\nb", "ä\u2028\u202e",
    "9" * 5000, "x" * 70_000, [], {}, [[]], [0, 0], [1.0, 2.0, 3.0], {"": 0}, {"a": {"b": [1]}},
)  # fmt: skip
NUMBERS = (
    "nan", "inf", "-inf", "1e999", "-1e308", "1e300", "1e-320", "0", "-0", "-1", "1", "1e6", "1000001", "1e12", "0x10",
    "1_0", "", "x", "1e", "--1", "1,1", "9" * 5000, "1" + "0" * 400, "٣", "\0", "1;2", "#", "=", "[", "]", "5", "0.5",
)  # fmt: skip
BYTES = (
    b"\0",
    b"\xff",
    b"\x7f",
    b"\x80",
    b"\n",
    b"\r",
    b"{",
    b"[",
    b'"',
    b"\xff\xff\xff\xff",
    b"\0" * 8,
    b"-",
    b"9" * 400,
)
DEPTHS = (30, 900, 30_000)


def places(tree: Any, path: tuple = ()) -> list[tuple]:
    """Paths of all values in a tree of dicts and lists, the root first."""
    found = [path]
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        found += places(value, (*path, key))
    return found


def mutated_tree(random: Random, tree: Any) -> Any:
    """A copy with one to three values replaced, scaled, deleted, doubled or moved."""
    tree = deepcopy(tree)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        path: tuple[Any, ...] = random.choice(places(tree)[1:] or [()])
        if not path:
            return deepcopy(random.choice(NASTY))
        holder: Any = tree
        for key in path[:-1]:
            holder = holder[key]
        tree = _changed(random, tree, holder, path[-1])
    return tree


def _changed(random: Random, tree: Any, holder: Any, key: Any) -> Any:
    value, roll = holder[key], random.random()
    if roll < 0.45:
        holder[key] = deepcopy(random.choice(NASTY))  # another mutation may change it
    elif roll < 0.65 and isinstance(value, int | float) and not isinstance(value, bool):
        with suppress(OverflowError, ValueError):  # of what is huge or NaN already
            holder[key] = type(value)(random.choice((-1, 0.5, 2, 10, 1e3, 1e6, 1.0 + 1e-9)) * value)
    elif roll < 0.75:
        del holder[key]
    elif roll < 0.85 and isinstance(holder, list):
        holder.insert(random.randrange(len(holder) + 1), deepcopy(value))
    elif roll < 0.92 and isinstance(holder, dict):
        holder[random.choice(("extra", "id", "x", key.upper() if isinstance(key, str) else "k"))] = deepcopy(value)
    else:
        others = places(tree)[1:]
        other: Any = tree
        for step in random.choice(others) if others else ():
            other = other[step]
        holder[key] = deepcopy(other)
    return tree


def json_bytes(random: Random, tree: Any) -> bytes:
    """A mutated tree as JSON; now and then a key given twice, numbers that JSON has no words for, or a deep nest."""
    text = json.dumps(mutated_tree(random, tree), ensure_ascii=random.random() < 0.5)
    roll = random.random()
    if roll < 0.03:
        depth = random.choice(DEPTHS)
        text = text.replace(random.choice((": ", ", ")), f": {'[' * depth}{']' * depth}, ", 1)
    elif roll < 0.06:
        text = text.replace(str(random.randrange(10)), random.choice(NUMBERS), 1)
    elif roll < 0.12:
        return mutated_bytes(random, text.encode(errors="surrogatepass"))
    return text.encode(errors="surrogatepass")


def mutated_rows(random: Random, data: bytes) -> bytes:
    """A text table with words or lines changed."""
    if random.random() < 0.1:
        return mutated_bytes(random, data)
    lines = data.decode().split("\n")
    for _ in range(random.choice((1, 1, 2, 4))):
        at = random.randrange(len(lines))
        roll = random.random()
        if roll < 0.55:
            words = lines[at].replace("=", " = ").replace(",", " , ").split(" ")
            words[random.randrange(len(words))] = random.choice(NUMBERS)
            lines[at] = " ".join(words).replace(" , ", ",").replace(" = ", "=")
        elif roll < 0.65 and len(lines) > 1:
            del lines[at]
        elif roll < 0.75:
            lines.insert(at, random.choice(lines))
        elif roll < 0.85:
            other = random.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        elif roll < 0.9:
            lines[at] += " " + random.choice(NUMBERS)
        elif roll < 0.95:
            lines.insert(at, random.choice(("", "#", "# x", "x" * 5000, "0 " * 20, "[net]", "[yolo]", "a=b")))
        else:
            lines[at] = lines[at].replace(random.choice("0123456789"), random.choice("0123456789e-. "))
    return "\n".join(lines).encode()


def mutated_bytes(random: Random, valid: bytes) -> bytes:
    """Bytes flipped, overwritten, cut, doubled, moved or put in; numbers of two to eight bytes set to extremes."""
    data = bytearray(valid)
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        if not data:
            return bytes(data)
        at, roll = random.randrange(len(data)), random.random()
        if roll < 0.3:
            data[at] ^= 1 << random.randrange(8)
        elif roll < 0.45:
            data[at] = random.randrange(256)
        elif roll < 0.65:
            size = random.choice((2, 4, 8))
            number = random.choice((0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1))
            data[at : at + size] = struct.pack(random.choice("<>") + "Q", number)[:size]
        elif roll < 0.72:
            del data[at:]
        elif roll < 0.8:
            del data[at : at + random.choice((1, 4, 100))]
        elif roll < 0.9:
            data[at:at] = random.choice(BYTES)
        else:
            start = random.randrange(len(data))
            data[at:at] = data[start : start + random.choice((1, 8, 64, 1000))]
    return bytes(data)
