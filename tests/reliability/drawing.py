"""Documents drawn from the formats' own types: every value at or near its bounds, now and then one step outside.

Nothing here starts from a valid file. A schema (msgspec's types, the columns of a table) says what may stand where, and
`ValueSource` fills it; `hurt` says at each value whether it is to break the rule that the schema gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Any, TypeVar

from msgspec import inspect

from edgemap.runtime.frames.number_rows import NumberTable

T = TypeVar("T")

ODD_TEXTS = (
    "", " ", "a" * 201, "a" * 5000, "\x1b[2J", "a\nb", "a\0b", "\u202egnp.exe", "é", "日本", "🪑", "..", "../../x", "/etc/x",
    "$\\frac{", "<script>", "=1+1", "%s%n", "{0}", "nan", "null", "1e5", "-0", "__proto__", "chair",
)  # fmt: skip
ODD_NUMBERS = (
    "NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e308", "-1e308", "5e-324", "9" * 400, "9" * 5000, "-0", "0.0",
    "18446744073709551616", "-9223372036854775809", "1E+2", "1_0", "0x10", "01", "+1", ".5", "1.", "1e", "1.5", "true",
)  # fmt: skip
ODD_TOKENS = (
    "null",
    "true",
    "[]",
    "{}",
    '""',
    "[[]]",
    '"x"',
    "0",
    "-1",
    "1.5",
    "[1,2,3,4]",
    '{"a":{}}',
    "nul",
    "'x'",
    "",
)
NAMES = ("chair", "couch", "potted plant", "bed", "dining table", "tv", "person", "x", "chair-1", "a b", "ä")


class Raw(str):
    """JSON text that goes into the document as it is."""


class ValueSource:
    """A seeded source of values. damage: chance of each value to break its rule; 0 for a document that is right."""

    def __init__(self, random: Random, damage: float | None = None) -> None:
        self.random = random
        self.damage = random.choice((0.0, 0.0, 0.01, 0.03, 0.1, 0.3)) if damage is None else damage

    def hurt(self) -> bool:
        """Whether the value at hand is to be wrong."""
        return self.random.random() < self.damage

    def chance(self, share: float) -> bool:
        """True that often."""
        return self.random.random() < share

    def pick(self, items: Sequence[T]) -> T:
        """One of them."""
        return self.random.choice(items)

    def real(self, least: float, most: float) -> float:
        """A number in the closed range: often a bound, often small, often a few bits from a bound."""
        near = self.random.gauss(0.0, 3.0)
        chosen = self.pick((least, most, 0.0, near, near, near, round(near), self.random.uniform(least, most)))
        if self.chance(0.05):
            chosen = math.nextafter(chosen, self.pick((least, most)))
        return min(max(chosen, least), most)

    def whole(self, least: int, most: int) -> int:
        """As `real`, whole numbers."""
        small = least + self.random.randrange(8)
        return min(max(self.pick((least, most, small, small, small, self.random.randint(least, most))), least), most)

    def count(self, most: int) -> int:
        """A length: short ones mostly."""
        return min(most, self.pick((0, 1, 1, 2, 2, 3, 5, 9)))

    def text(self) -> str:
        """A name, or something that may not be one."""
        if self.chance(0.85):
            return self.pick(NAMES) if self.chance(0.5) else f"{self.pick(NAMES)[:150]}-{self.random.randrange(30)}"
        return self.pick(ODD_TEXTS)


def of_type(draw: ValueSource, kind: Any) -> Any:
    """A value of a type that `msgspec.inspect.type_info` understands; wrong ones where `draw` says so."""
    return _value(draw, inspect.type_info(kind), 0)


def _value(draw: ValueSource, info: Any, depth: int) -> Any:
    if draw.hurt():
        return Raw(draw.pick((*ODD_TOKENS, *ODD_NUMBERS)) if draw.chance(0.97) else draw.pick(("[", "{")) * 3000)
    match info:
        case inspect.StructType():
            return _record(draw, info, depth)
        case inspect.IntType():
            least = info.ge if info.ge is not None else -9
            most = info.le if info.le is not None else 1 << 20
            return draw.whole(least, most) + (draw.pick((-1, 1)) * (most - least + 1) if draw.hurt() else 0)
        case inspect.FloatType():
            least = (
                info.ge if info.ge is not None else math.nextafter(info.gt, math.inf) if info.gt is not None else -9.0
            )
            most = info.le if info.le is not None else math.nextafter(info.lt, 0.0) if info.lt is not None else 9.0
            value = draw.real(least, most)
            return value if not draw.hurt() else draw.pick((math.nextafter(most, math.inf), least - 1e-9, most * 10))
        case inspect.StrType():
            text = draw.text()
            if info.pattern and "0-9a-f" in info.pattern:
                text = "".join(
                    draw.pick("0123456789abcdef") for _ in range(64 + (draw.pick((-1, 1)) if draw.hurt() else 0))
                )
            return text
        case inspect.BoolType():
            return draw.chance(0.5)
        case inspect.LiteralType():
            return draw.pick(info.values)
        case inspect.TupleType():
            items = [_value(draw, item, depth + 1) for item in info.item_types]
            return items if not draw.hurt() else items[: draw.random.randrange(len(items) + 1)] + items[:1]
        case inspect.ListType() | inspect.VarTupleType():
            count = max(info.min_length or 0, draw.count(min(info.max_length or 9, 9)))
            return [_value(draw, info.item_type, depth + 1) for _ in range(count if not draw.hurt() else 0)]
        case inspect.DictType():
            return {
                str(_value(draw, info.key_type, depth + 1)): _value(draw, info.value_type, depth + 1)
                for _ in range(draw.count(4))
            }
        case inspect.UnionType():
            return _value(draw, draw.pick(info.types), depth)
        case inspect.NoneType():
            return None
        case inspect.Metadata():
            return _value(draw, info.type, depth)
    return draw.pick((None, 1, "x", [1, [2]], {"a": {"b": [0.5]}}))  # any value


def _record(draw: ValueSource, info: Any, depth: int) -> dict[str, Any]:
    found = {}
    for field in info.fields:
        if (not field.required and draw.chance(0.4)) or draw.hurt():
            continue
        name = field.encode_name if not draw.hurt() else field.encode_name.upper()
        found[name] = _value(draw, field.type, depth + 1)
    if draw.hurt() or (not info.forbid_unknown_fields and draw.chance(0.05)):
        found[draw.text()] = draw.pick((1, "x", None, Raw("[" * 600 + "]" * 600), {"deep": [{}] * 3}))
    return found


def json_text(draw: ValueSource, value: Any) -> str:
    """A value as JSON, spelled in any of the ways that JSON allows; where `draw` hurts, in one that it does not."""
    if isinstance(value, Raw):
        return "".join(value)
    if isinstance(value, dict):
        items = [
            f"{_quoted(draw, name)}{draw.pick((':', ' : '))}{json_text(draw, item)}" for name, item in value.items()
        ]
        if items and draw.hurt():
            items.append(draw.pick((items[0], "", "// x", '"a"', "1:1")))
        return "{" + draw.pick((",", ", ", ",\n\t")).join(items) + "}"
    if isinstance(value, list | tuple):
        return (
            "["
            + draw.pick((",", ", ")).join(json_text(draw, item) for item in value)
            + ("," if draw.hurt() else "")
            + "]"
        )
    if isinstance(value, str):
        return _quoted(draw, value)
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(value)
    if "e" in text and draw.chance(0.3):
        text = text.replace("e", "E")
    return {"inf": "1e999", "-inf": "-1e999", "nan": "NaN"}.get(text, text)


def _quoted(draw: ValueSource, text: str) -> str:
    letters = []
    for letter in text:
        code = ord(letter)
        if letter in '"\\' or code < 32 or (code < 0x10000 and draw.chance(0.01)):
            letters.append(f"\\u{code:04x}" if not draw.hurt() else draw.pick((letter, "\\ud800", "\\x", "\\u12")))
        else:
            letters.append(letter)
    return '"' + "".join(letters) + ('"' if not draw.hurt() or draw.chance(0.8) else "")


def encoded(draw: ValueSource, text: str) -> bytes:
    """A text as a file's bytes; where `draw` hurts, cut, or in no UTF-8."""
    data = text.encode("utf-8", "surrogatepass")
    if draw.damage and draw.chance(0.04):
        cut = draw.random.randrange(len(data) + 1)
        data = draw.pick((
            data[:cut], data[:cut] + b"\xff" + data[cut:], b"\xef\xbb\xbf" + data, data + data, data.decode("utf-8", "ignore").encode("utf-16"),
            data + b"\0", b"", data[:cut] + b"\xc3" + data[cut:],
        ))  # fmt: skip
    return data


def json_bytes(draw: ValueSource, kind: Any, mend: Callable[[ValueSource, Any], None] | None = None) -> bytes:
    """A document of a type as a JSON file. mend: makes true what a type cannot say (ids that are unlike)."""
    tree = of_type(draw, kind)
    if mend is not None and isinstance(tree, dict):
        mend(draw, tree)
    return encoded(draw, json_text(draw, tree))


def yaml_text(draw: ValueSource, value: Any, indent: int = 0) -> str:
    """A value as YAML, in block or flow style, with what YAML has beyond JSON where `draw` hurts."""
    pad = " " * indent
    if draw.hurt():
        return draw.pick((
            "!!python/object/apply:os.system [x]", "!!int x", "!!float y", "!!binary AA==", "2024-99-99", "2024-01-01", "*a",
            "&a x", "<<: {a: 1}", "0x" + "f" * 500, "0b" + "1" * 500, "1:2:3:4", "190:20:30.15", "~", "? a", "- - -", "[" * 300,
            "{" * 300, "|\n  x", ">-\n  y", "@x", "`x", "%x", "\tx", "'x", '"\\xZZ"', "yes", "1e3", ".inf", ".nan", "9" * 5000,
            "!!set {a, b}", "!!omap [a: 1]", "!!timestamp 2001-12-14t21:59:43.10-05:00", "--- x", "...", "# x", "!<x> y", "! x",
        ))  # fmt: skip
    if isinstance(value, Raw):
        return str(value)[:2000] or "''"
    if isinstance(value, dict) and value and draw.chance(0.7):
        lines = []
        for name, item in value.items():
            nested = isinstance(item, dict) and item and draw.chance(0.5)
            text = yaml_text(draw, item, indent + 2)
            simple = nested and text.startswith("\n")
            lines.append(f"{pad}{_key(draw, name)}:{'' if simple else ' '}{text}")
        return ("\n" if indent else "") + "\n".join(lines)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(draw, name)}: {_flow(draw, item)}" for name, item in value.items()) + "}"
    return _flow(draw, value)


def _flow(draw: ValueSource, value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(draw, name)}: {_flow(draw, item)}" for name, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(draw, item) for item in value) + "]"
    if isinstance(value, float) and not isinstance(value, bool) and draw.chance(0.1):
        return f"{value:e}"
    if isinstance(value, str) and value.replace("_", "").isalnum() and value.isascii() and draw.chance(0.5):
        return value
    return json_text(draw, value)


def _key(draw: ValueSource, name: str) -> str:
    if draw.hurt():
        return draw.pick(("1", "null", "[a]", "? [b]", "&k k", "true", "2024-01-01", name.upper() or "k", "''"))
    return name if name.replace("_", "").isalnum() and name.isascii() else json_text(draw, name)


def table_bytes(
    draw: ValueSource,
    table: NumberTable,
    rows: int | None = None,
    mend: Callable[[ValueSource, list[list[float]]], None] | None = None,
) -> bytes:
    """A text table. mend: makes true what columns cannot say (stamps that rise, quaternions of length 1)."""
    count = draw.pick((0, 1, 2, 3, 5, 20)) if rows is None else rows
    numbers = [[draw.real(column.minimum, column.maximum) for column in table.columns] for _ in range(count)]
    if mend is not None:
        mend(draw, numbers)
    joint = table.separator or draw.pick((" ", "  ", "\t", ",", ", "))
    lines = (
        [(table.separator or " ").join(column.name for column in table.columns)]
        if table.header and not draw.hurt()
        else []
    )
    for row in numbers:
        words = [draw.pick((repr, lambda value: f"{value:.6f}", lambda value: f"{value:e}"))(value) for value in row]
        if draw.hurt():
            words[draw.random.randrange(len(words))] = draw.pick((*ODD_NUMBERS, *ODD_TEXTS))
        if draw.hurt():
            words = draw.pick((words[:-1], words + ["0"], [], words[::-1], ["#", *words]))
        lines.append(joint.join(words))
        if draw.chance(0.02):
            lines.append(draw.pick(("", "# comment", "   ", "#" * 300)))
    end = draw.pick(("\n", "\n", "\r\n")) if not draw.hurt() else draw.pick(("\r", "\x0b", "\u2028", "\0"))
    return encoded(draw, end.join(lines) + draw.pick(("", end)))


def rising(draw: ValueSource, rows: list[list[float]], column: int = 0) -> None:
    """Stamps that rise, mostly in a usual step; now and then one that does not."""
    now = draw.pick((0.0, 0.0, 1.7e9, -5.0, 1e11))
    for row in rows:
        now += draw.pick((0.1, 0.1, 1 / 30, 1e-6, 100.0)) if not draw.hurt() else draw.pick((0.0, -1.0, 1e-17, 1e300))
        row[column] = now


def unit(draw: ValueSource, rows: list[list[float]], first: int, count: int = 4) -> None:
    """Quaternions of length 1 in the columns from `first`; now and then of another."""
    for row in rows:
        values = [draw.random.gauss(0.0, 1.0) for _ in range(count)]
        if draw.chance(0.3):
            values = draw.pick(([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.7071, 0.7071], [-0.5, 0.5, -0.5, 0.5]))
        length = math.hypot(*values) * (1.0 if not draw.hurt() else draw.pick((0.2, 5.0, 1e5, 1e-9, 1.019)))
        row[first : first + count] = [value / (length or 1.0) for value in values]
