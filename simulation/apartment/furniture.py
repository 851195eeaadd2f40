"""The Sweet Home 3D furniture catalogue: what there is, how big, by whom, and which models look like what.

Debian's `sweethome3d-furniture` brings five libraries of OBJ models with real sizes. `models.toml` names, per kind,
the ones that COCO-trained detectors recognise when they are drawn by this renderer.
"""

import colorsys
import re
import tomllib
import zipfile
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np

from edgemap.simulation.apartment.made import FLAT_TOPS, LIBRARY, made
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Colour, Material, Mesh, Part, triangles_of
from edgemap.simulation.render.obj import read_obj, simplified

LIBRARIES = Path("/usr/share/sweethome3d/furniture")
LICENCES = {
    "BlendSwap-CC-0": "CC0 1.0",
    "BlendSwap-CC-BY": "CC BY 3.0",
    "KatorLegaz": "CC BY 3.0 US",
    "Reallusion": "CC BY 3.0 US",
    "Scopia": "CC BY 3.0",
}
# A home of some fifty pieces stays below a quarter of a million.
_MOST_TRIANGLES = 9000
# Which homes show what: those to train on, to choose by, to test with, and the block whose scores decide nothing.
Purpose = Literal["training", "validation", "test", "frozen"]
# Made models of the frozen block, by kind, numbered far from those of training.
_FROZEN_NUMBERS = range(101, 105)


@dataclass(frozen=True, slots=True)
class Model:
    """One catalogue entry. Sizes in metres: width across the front, depth front to back. key: `library/file`.

    scale: of these sizes against the catalogue's, (depth, width, height). elevation_m: height above the floor of
    wall-mounted pieces. top_m: height of a flat top that can carry things; 0 where there is none.
    """

    library: str
    name: str
    creator: str
    path: str
    width_m: float
    depth_m: float
    height_m: float
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    elevation_m: float = 0.0
    top_m: float = 0.0
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def key(self) -> str:
        """Short unique name: library and OBJ file."""
        return f"{self.library}/{Path(self.path).stem}"

    def scaled(self, factor: float, stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> "Model":
        """The same model larger or smaller in all directions, and stretched in depth, width and height."""
        depth, width, height = (factor * part for part in stretch)
        return replace(
            self,
            width_m=self.width_m * width,
            depth_m=self.depth_m * depth,
            height_m=self.height_m * height,
            top_m=self.top_m * height,
            scale=(self.scale[0] * depth, self.scale[1] * width, self.scale[2] * height),
        )


@dataclass(frozen=True, slots=True)
class Kind:
    """Interchangeable models. label: their COCO class, "" for mere decoration. held_out: for testing only.

    made: more to train on. frozen: of the frozen block only. scale: by key, of real pieces against the catalogue's.
    """

    label: str
    training: tuple[str, ...]
    made: tuple[str, ...]
    held_out: tuple[str, ...]
    frozen: tuple[str, ...]
    scale: dict[str, float]

    def choices(self, purpose: Purpose) -> tuple[str, ...]:
        """Keys to draw from: for tests the held-out ones where the kind has any, for training the made ones too."""
        if purpose == "training":
            return self.training + self.made
        if purpose == "frozen" and self.frozen:
            return self.held_out + self.frozen
        return self.held_out if purpose in ("test", "frozen") and self.held_out else self.training


@lru_cache(maxsize=1)
def kinds() -> dict[str, Kind]:
    """Every kind of furniture that rooms draw from, from `models.toml`."""
    entries = tomllib.loads(resources.files("edgemap.simulation.apartment").joinpath("models.toml").read_text())
    found = {}
    for name, entry in entries.items():
        models, held_out = entry["models"], entry.get("held_out", ())
        numbered = (f"{LIBRARY}/{name}-{number}" for number in range(1, entry.get("made", 0) + 1))
        frozen = tuple(f"{LIBRARY}/{name}-{number}" for number in _FROZEN_NUMBERS if "made" in entry)
        training = tuple(key for key in models if key not in held_out)
        more = tuple(key for key in numbered if key not in models)
        found[name] = Kind(entry.get("label", ""), training, more, tuple(held_out), frozen, entry.get("scale", {}))
    return found


def people(purpose: Purpose) -> tuple[Model, ...]:
    """Models of standing people, for walkers in a home."""
    return tuple(model_of(key) for key in kinds()["person"].choices(purpose))


@lru_cache(maxsize=1)
def catalogue() -> dict[str, Model]:
    """The libraries' models by key. Raises SimulationError naming the Debian package where the libraries are absent."""
    models = {}
    for library in LICENCES:
        text = _archive(library).read("PluginFurnitureCatalog.properties").decode("latin1")
        entries: dict[int, dict[str, str]] = {}
        for word, number, value in re.findall(r"^(\w+)#(\d+)\s*[=:]\s*(.*?)\s*$", text, re.MULTILINE):
            entries.setdefault(int(number), {})[word] = value
        for entry in entries.values():
            width, depth, height = (float(entry[side]) / 100.0 for side in ("width", "depth", "height"))
            rotation = tuple(float(number) for number in entry.get("modelRotation", "1 0 0 0 1 0 0 0 1").split())
            creator, path = entry.get("creator", library), entry["model"].lstrip("/")
            elevation = float(entry.get("elevation", 0.0)) / 100.0
            top = max(float(entry.get("dropOnTopElevation", entry["height"])) / 100.0, 0.0)
            model = Model(library, entry["name"], creator, path, width, depth, height, rotation, elevation, top)
            models.setdefault(model.key, model)
    return models


def model_of(key: str) -> Model:
    """A model of the libraries or of our own. Raises SimulationError for an unknown key."""
    if key.startswith(f"{LIBRARY}/"):
        return _made_model(key)
    if key not in catalogue():
        raise SimulationError(f"no furniture model {key!r} in {LIBRARIES}")
    return catalogue()[key]


@lru_cache(maxsize=4096)
def _made_model(key: str) -> Model:
    depth, width, height = (float(side) for side in np.ptp(triangles_of(load(key)).reshape(-1, 3), axis=0))
    name = key.partition("/")[2]
    kind, _, number = name.rpartition("-")
    top = height if kind in FLAT_TOPS else 0.0
    return Model(LIBRARY, f"{kind} {number}", "edgemap", name, width, depth, height, top_m=top)


@dataclass(frozen=True, slots=True)
class Tint:
    """How one piece differs in colour from its model. hue: turn of plain colours, in circles. cast: linear factors (3,)
    on everything, textures too."""

    hue: float = 0.0
    cast: Colour = (1.0, 1.0, 1.0)

    @classmethod
    def draw(cls, rng: np.random.Generator, strength: float) -> "Tint | None":
        """A tint; None for about half of the pieces. strength: 1 for painted and woven pieces, near 0 for plants."""
        if rng.random() < 0.5:
            return None
        brightness = float(np.exp(rng.normal(0.0, 0.28 * strength)))
        cast = brightness * np.exp(rng.normal(0.0, 0.14 * strength, 3))
        return cls(float(rng.uniform(-0.5, 0.5)) * strength, tuple(np.clip(cast, 0.45, 1.5).tolist()))

    def on(self, material: Material) -> Material:
        """The material in this tint; what glows or lets light through keeps its colour."""
        if max(material.emission) > 0.0 or material.see_through:
            return material
        colour = material.colour
        if material.texture is None and self.hue:
            hue, lightness, saturation = colorsys.rgb_to_hls(*np.clip(colour, 0.0, 1.0))
            colour = colorsys.hls_to_rgb((hue + self.hue) % 1.0, lightness, saturation)
        return replace(material, colour=tuple(min(c * cast, 1.2) for c, cast in zip(colour, self.cast, strict=True)))


def piece(model: Model, tint: Tint | None = None) -> Mesh:
    """The mesh of one piece: the model at this piece's size, in its tint."""
    parts = []
    for part in load(model.key):
        normals = part.normals
        if len(set(model.scale)) > 1:
            normals = normals / model.scale
            normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
        material = part.material if tint is None else tint.on(part.material)
        parts.append(Part(material, part.positions * model.scale, normals, part.uv))
    return parts


@lru_cache(maxsize=512)
def load(key: str) -> Mesh:
    """A model's mesh at the catalogue's size.

    Metres, REP-103 (x out of its front, y left, z up), origin on the floor at the box's centre.
    Raises SimulationError for an unknown key.
    """
    if key.startswith(f"{LIBRARY}/"):
        return made(key.partition("/")[2])
    model = model_of(key)
    size = (model.width_m, model.height_m, model.depth_m)
    return simplified(read_obj(_archive(model.library), model.path, model.rotation, size), _MOST_TRIANGLES)


@lru_cache(maxsize=8)
def _archive(library: str) -> zipfile.ZipFile:
    path = LIBRARIES / f"{library}.sh3f"
    if not path.exists():
        raise SimulationError(f"{path} is missing: apt-get install sweethome3d-furniture")
    return zipfile.ZipFile(path)
