"""HTML and SVG elements as text; everything that is not Markup is escaped."""

from base64 import b64encode
from collections.abc import Iterable
from html import escape

_VOID = frozenset({"br", "img", "meta", "link", "hr"})


class Markup(str):
    """Text that is HTML or SVG already."""

    __slots__ = ()


Child = str | Markup | None | Iterable["str | Markup | None"]


def el(name: str, /, *children: Child, **attributes: object) -> Markup:
    """An element. Plain strings are escaped, Markup is not, None is left out; `class_` and `stroke_width` become
    `class` and `stroke-width`; attributes that are None are left out, numbers are rounded to a tenth or a hundredth."""
    words = "".join(f' {key.strip("_").replace("_", "-")}="{_value(value)}"' for key, value in attributes.items()
                    if value is not None)  # fmt: skip
    if name in _VOID:
        return Markup(f"<{name}{words}>")
    return Markup(f"<{name}{words}>{joined(*children)}</{name}>")


def joined(*children: Child) -> Markup:
    """Children as one text; what is not Markup is escaped."""
    parts: list[str] = []
    for child in children:
        if child is None:
            continue
        if isinstance(child, Markup):
            parts.append(child)
        elif isinstance(child, str):
            parts.append(escape(child))
        else:
            parts.extend(joined(part) for part in child)
    return Markup("".join(parts))


def prose(text: str) -> Markup:
    """A sentence whose words in backticks are code."""
    return joined(el("code", part) if place % 2 else part for place, part in enumerate(text.split("`")))


def polyline(points: Iterable[Iterable[float]]) -> str:
    """Points for `points=` of a polyline or polygon."""
    return " ".join(",".join(_value(float(v)) for v in point) for point in points)


def data_uri(picture: bytes, kind: str = "image/jpeg") -> str:
    """A picture file as an address that needs no request."""
    return f"data:{kind};base64," + b64encode(picture).decode()


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.2f}".rstrip("0").rstrip(".") if abs(value) < 100 else f"{value:.1f}"
    return escape(str(value))
