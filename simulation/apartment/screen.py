"""`python -m edgemap.simulation.apartment.screen --bundle DIR -o DIR [KIND...]`: which models does a detector know?

Every model of `models.toml` that has a label is drawn from eight sides in a plain lit room, from a robot's height, and
shown to a detector trained on photographs. `screen.json` says per model in how many views it was found as its label,
and as what else; `KIND.jpg` shows the pictures. A model that is found from no side is suspect: look at it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import load_bundle
from edgemap.runtime.decode import Detector
from edgemap.simulation.apartment import furniture, textures
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.render.light import BakeSettings, bake
from edgemap.simulation.render.mesh import Material
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.scene import AreaLight, Scene, Solid, Surface
from edgemap.simulation.render.view import View

_SIDES = 8
_OVERLAP, _CONFIDENCE = 0.4, 0.25
_ROOM_M, _HEIGHT_M = 7.0, 2.6
_CAMERA = Intrinsics(416, 312, 340.0, 340.0, 207.5, 155.5)
_LIGHT = BakeSettings(texel_m=0.15, vertex_spacing_m=0.5, lamp_samples=4, hemisphere_samples=8, bounces=2)

Picture = NDArray[np.uint8]


def main() -> int:
    """Screen the kinds asked for (all with a label by default); known failures are one line and exit code 1."""
    parser = argparse.ArgumentParser(prog="python -m edgemap.simulation.apartment.screen", description=__doc__)
    parser.add_argument("kinds", nargs="*", help="kinds of models.toml")
    parser.add_argument("--bundle", type=Path, required=True, help="folder of a bundle with COCO classes")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the result")
    options = parser.parse_args()
    try:
        detector = Detector(load_bundle(options.bundle))
        options.out.mkdir(parents=True, exist_ok=True)
        result = {}
        wanted = options.kinds or [name for name, kind in furniture.kinds().items() if kind.label]
        for name in wanted:
            kind, rows = furniture.kinds()[name], []
            for key in (*kind.training, *kind.made, *kind.held_out):
                model, seen, pictures = furniture.model_of(key), Counter(), []
                for picture, box in views(model):
                    found = seen_as(detector, picture, box, kind.label)
                    seen[found] += 1
                    pictures.append(_captioned(picture, f"{key.split('/')[1]}: {found or '-'}", found == kind.label))
                triangles = len(furniture.load(key).triangles())
                result[key] = {"kind": name, "found": seen[kind.label], "seen_as": dict(seen), "triangles": triangles}
                print(f"{name:14} {key:40} {seen[kind.label]}/{_SIDES} {triangles:6d} {dict(seen)}", flush=True)
                rows.append(np.hstack(pictures))
            cv2.imwrite(str(options.out / f"{name.replace(' ', '-')}.jpg"), np.vstack(rows))
        (options.out / "screen.json").write_text(json.dumps(result, indent=1))
    except EdgemapError as error:
        print(f"edgemap.simulation.apartment.screen: {error}", file=sys.stderr)
        return 1
    return 0


def views(model: Model) -> Iterator[tuple[Picture, NDArray[np.float64]]]:
    """Pictures (BGR) of one model from all sides, each with its visible box (x0, y0, x1, y1), pixels."""
    z = model.elevation_m
    solid = Solid(1, furniture.piece(model).placed(_ROOM_M / 2.0, _ROOM_M / 2.0, z, 0.0))
    lit = bake(Scene(_room(), (solid,), (_lamp(),)), 0, _LIGHT)
    renderer = Renderer(lit, _CAMERA, exposure=1.9)
    size = max(model.width_m, model.depth_m, model.height_m)
    distance = float(np.clip(1.35 * size + 0.35, 0.7, 3.2))
    mount = Mount.from_degrees(0.6, 12.0 if z < 0.3 else 0.0)
    try:
        for turn in np.arange(_SIDES) * 2.0 * np.pi / _SIDES + 0.2:
            pose = SE2(_ROOM_M / 2.0, _ROOM_M / 2.0, turn) @ SE2(-distance, 0.0, 0.0)
            view = View.of_base(pose, mount)
            rows, columns = np.nonzero(renderer.ids_and_depth(view)[0] == 1)
            if len(rows):
                box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], dtype=np.float64)
                yield renderer.picture(view), box
    finally:
        renderer.close()


def seen_as(detector: Detector, picture: Picture, box: NDArray[np.float64], label: str) -> str:
    """The label if the detector finds it there, else the surest other class that it finds there, else ""."""
    found = detector(picture)
    there = [
        (found.labels[i], float(found.scores[i]))
        for i in range(len(found))
        if found.scores[i] >= _CONFIDENCE and _overlap(found.boxes[i], box) >= _OVERLAP
    ]
    names = [name for name, _ in there]
    return label if label in names else names[0] if names else ""


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Intersection over union."""
    shared = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0).prod()
    return float(shared / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - shared))


def _room() -> tuple[Surface, ...]:
    rng = np.random.default_rng(0)
    floor = Material((1.0, 1.0, 1.0), textures.planks(rng, (184.0, 140.0, 98.0), 512), gloss=0.1)
    wall = Material((0.62, 0.60, 0.55))
    x, y, z = np.diag([_ROOM_M, _ROOM_M, _HEIGHT_M])
    return (
        Surface(np.zeros(3), x, y, floor, (1.9, 1.9)),
        Surface(z, y, x, Material((0.84, 0.84, 0.82))),
        Surface(x, -x, z, wall),
        Surface(np.zeros(3), y, z, wall),
        Surface(y, x, z, wall),
        Surface(x + y, -y, z, wall),
    )


def _lamp() -> AreaLight:
    corner = np.array([_ROOM_M / 2.0 - 1.0, _ROOM_M / 2.0 - 1.0, _HEIGHT_M - 0.02])
    return AreaLight(corner, np.array([0.0, 2.0, 0.0]), np.array([2.0, 0.0, 0.0]), np.array([3.0, 2.85, 2.6]))


def _captioned(picture: Picture, text: str, good: bool) -> Picture:
    small = cv2.resize(picture, (208, 156), interpolation=cv2.INTER_AREA)
    cv2.putText(small, text[:34], (3, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.34, (0, 110, 0) if good else (0, 0, 200), 1)
    return np.asarray(small, dtype=np.uint8)


if __name__ == "__main__":
    sys.exit(main())
