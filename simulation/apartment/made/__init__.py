"""Furniture of our own: `edgemap/vase-1` and so on, which needs no catalogue and no licence.

`pieces/KIND.json.xz` holds each piece as shapes (functions of shapes/ with their arguments in metres) and materials.
Test and validation homes show the few that `models.toml` lists for what the libraries have too few of; training homes
show as many more as its `made` gives. The generators that drew them are in this repository's history, at 70b7955.
"""

import json
import lzma
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from edgemap.simulation.apartment.made import textures
from edgemap.simulation.apartment.made.shapes import lofts, solids
from edgemap.simulation.apartment.made.shapes.leaves import leaves
from edgemap.simulation.apartment.textures import Texture
from edgemap.simulation.render.mesh import Material, Mesh, Part, box, quad, triangles_of

LIBRARY = "edgemap"
# Kinds whose top carries other furniture.
FLAT_TOPS = {"dining table"}

_SHAPES: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        solids.beam, solids.rod, solids.rounded, solids.cushion, solids.padded, lofts.surface, lofts.loft, lofts.lathe,
        lofts.sheet, box, quad, leaves, lofts.oval, lofts.raised, lofts.rectangle,
    )
}  # fmt: skip


def made(name: str) -> Mesh:
    """`KIND-NUMBER` in metres, x out of its front, y left, z up, origin on the floor at its box's centre."""
    kind, _, number = name.rpartition("-")
    piece = _pieces(kind)[number]
    materials = _materials(piece["materials"], [sum(map(ord, kind)), int(number)])
    parts = [part for shape in piece["shapes"] for part in _shaped(dict(shape), materials)]
    points = triangles_of(parts).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    shift = -np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    return [part.moved(np.eye(3), shift) for part in parts]


@cache
def _pieces(kind: str) -> dict[str, Any]:
    """Each piece of a kind by its number, as text."""
    file = resources.files(__package__ or __name__) / "pieces" / f"{kind.replace(' ', '-')}.json.xz"
    return json.loads(lzma.decompress(file.read_bytes()))


def _materials(entries: list[dict[str, Any]], seed: list[int]) -> list[Material]:
    """A piece's materials; those with one texture share it. seed: of its textures' noise, `draws` numbers on."""
    drawn: dict[str, Texture] = {}
    materials = []
    for entry in entries:
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in entry.items()
        }
        if spec := values.pop("texture", None):
            if (key := json.dumps(spec)) not in drawn:
                given = {name: value for name, value in spec.items() if name not in ("of", "draws")}
                generator = np.random.PCG64(np.random.SeedSequence(seed)).advance(spec.get("draws", 0))
                rng = [] if spec["of"] == "leaf" else [np.random.Generator(generator)]
                drawn[key] = textures.DRAWN[spec["of"]](*rng, **given)
            values["texture"] = drawn[key]
        materials.append(Material(**values))
    return materials


def _shaped(shape: dict[str, Any], materials: list[Material]) -> list[Part]:
    """One shape's parts. parts: those that are shown, by default all; then: what they go through, in order."""
    function, shown, then = _SHAPES[shape.pop("build")], shape.pop("parts", None), shape.pop("then", [])
    for name, value in shape.items():
        if name == "materials":
            shape[name] = [materials[number] for number in value]
        elif name in ("material", "behind"):
            shape[name] = None if value is None else materials[value]
        else:
            shape[name] = _value(value)
    result = function(**shape)
    parts = [result] if isinstance(result, Part) else result
    parts = parts if shown is None else [parts[number] for number in shown]
    for way, *values in then:
        parts = [_THEN[way](part, *map(np.array, values)) for part in parts]
    return parts


def _value(value: Any) -> Any:
    """A list of numbers as an array, {"of": outline, its arguments} as its points, a list of those as one of arrays."""
    if isinstance(value, dict):
        return _SHAPES[value["of"]](**{name: _value(part) for name, part in value.items() if name != "of"})
    if isinstance(value, list):
        return [_value(part) for part in value] if isinstance(value[0], dict) else np.array(value)
    return value


_THEN: dict[str, Callable[..., Part]] = {
    "moved": Part.moved,
    "scaled": lambda part, about, factor: replace(part, positions=about + (part.positions - about) * factor),
    "flipped": lambda part: Part(part.material, part.positions[:, ::-1], -part.normals[:, ::-1], part.uv[:, ::-1]),
    "uv": lambda part, repeat: replace(part, uv=part.uv * repeat),
}
