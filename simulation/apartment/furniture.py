"""The Sweet Home 3D furniture catalogue: what there is, how big, by whom, and which models look like what.

Debian's `sweethome3d-furniture` brings five libraries of OBJ models with real sizes. `CHOICES` names, per COCO label,
the models that COCO-trained detectors recognise when they are drawn by this renderer (see the demo's README).
"""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Mesh
from edgemap.simulation.render.obj import read_obj

LIBRARIES = Path("/usr/share/sweethome3d/furniture")
LICENCES = {
    "BlendSwap-CC-0": "CC0 1.0",
    "BlendSwap-CC-BY": "CC BY 3.0",
    "KatorLegaz": "CC BY 3.0 US",
    "Reallusion": "CC BY 3.0 US",
    "Scopia": "CC BY 3.0",
}


@dataclass(frozen=True, slots=True)
class Model:
    """One catalogue entry. Sizes in metres: width across the front, depth front to back. key: `library/file`."""

    library: str
    name: str
    creator: str
    path: str
    width_m: float
    depth_m: float
    height_m: float
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

    @property
    def key(self) -> str:
        """Short unique name: library and OBJ file."""
        return f"{self.library}/{Path(self.path).stem}"

    @property
    def licence(self) -> str:
        """Licence of the library the model is from."""
        return LICENCES[self.library]


# Per kind: models that COCO-trained detectors recognise in most views when drawn by this renderer.
CHOICES: dict[str, tuple[str, ...]] = {
    "bookcase": ("BlendSwap-CC-0/bookcase",),
    "bottle": ("Scopia/wine_bottle", "KatorLegaz/red-wine-bottle-01"),
    "chair": ("BlendSwap-CC-0/chair", "BlendSwap-CC-0/thonet", "BlendSwap-CC-BY/chair4", "BlendSwap-CC-BY/plaidChair"),
    "couch": ("Scopia/simple_sofa", "Scopia/burlap_sofa", "Scopia/clear_sofa"),
    "cup": ("KatorLegaz/coffee-mug", "Scopia/cup"),
    "dining table": ("Scopia/round-table", "Scopia/table4"),
    "door": ("Scopia/puerta",),
    "easy chair": ("Scopia/armchair2",),
    "potted plant": ("BlendSwap-CC-BY/decorativePlant", "Scopia/maceta", "BlendSwap-CC-0/plant"),
    "radiator": ("BlendSwap-CC-0/radiator",),
    "refrigerator": ("KatorLegaz/fridge", "BlendSwap-CC-0/largeFridge"),
    "tv": ("Scopia/tv", "Scopia/wall-flat-tv"),
    "tv stand": ("BlendSwap-CC-BY/tvStand",),
    "floor lamp": ("Scopia/living_lamp",),
    "vase": ("Scopia/vase3", "Scopia/jar"),
}


@lru_cache(maxsize=1)
def catalogue() -> dict[str, Model]:
    """All models by key. Raises SimulationError naming the Debian package where the libraries are absent."""
    models = {}
    for library in LICENCES:
        text = _archive(library).read("PluginFurnitureCatalog.properties").decode("latin1")
        entries: dict[int, dict[str, str]] = {}
        for word, number, value in re.findall(r"^(\w+)#(\d+)\s*[=:]\s*(.*?)\s*$", text, re.MULTILINE):
            entries.setdefault(int(number), {})[word] = value
        for entry in entries.values():
            model = _model(library, entry)
            models.setdefault(model.key, model)
    return models


@lru_cache(maxsize=64)
def load(key: str) -> Mesh:
    """A model's mesh: metres, REP-103 (x out of its front, y left, z up), origin on the floor at the box's centre.

    Raises SimulationError for an unknown key.
    """
    if key not in catalogue():
        raise SimulationError(f"no furniture model {key!r} in {LIBRARIES}")
    model = catalogue()[key]
    size = (model.width_m, model.height_m, model.depth_m)
    return read_obj(_archive(model.library), model.path, model.rotation, size)


@lru_cache(maxsize=8)
def _archive(library: str) -> zipfile.ZipFile:
    path = LIBRARIES / f"{library}.sh3f"
    if not path.exists():
        raise SimulationError(f"{path} is missing: apt-get install sweethome3d-furniture")
    return zipfile.ZipFile(path)


def _model(library: str, entry: dict[str, str]) -> Model:
    width, depth, height = (float(entry[side]) / 100.0 for side in ("width", "depth", "height"))
    rotation = tuple(float(number) for number in entry.get("modelRotation", "1 0 0 0 1 0 0 0 1").split())
    creator = entry.get("creator", library)
    return Model(library, entry["name"], creator, entry["model"].lstrip("/"), width, depth, height, rotation)
