"""Training pictures for a detector: unrelated views of many homes in the `yolo` layout, with all of their truth.

images/HOME_VIEW.jpg    labels/HOME_VIEW.txt    boxes.json (visible share and whole box of everything in view)
floor/HOME_VIEW.png     1 floor, 2 wall, 0 other
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.runtime.frames.class_names import COCO_NAMES
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.frame import png
from edgemap.runtime.inputs.drives.yolo import write_yolo_labels
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.apartment import furnish
from edgemap.simulation.apartment.credits import PICTURES, credits_text
from edgemap.simulation.camera.exposure import light_levels, settled_gain
from edgemap.simulation.camera.film import encoded, sensed, shaken
from edgemap.simulation.camera.shutter import optical_twist
from edgemap.simulation.render.light import BakeSettings, bake
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.scene import LightMix, Probes
from edgemap.simulation.render.view import View
from edgemap.simulation.shots import ordered
from edgemap.simulation.store import PartStore, Progress
from edgemap.simulation.studio import EXPOSURE, light_mix
from edgemap.simulation.truth import floor_labels, is_visible, picture_boxes
from edgemap.simulation.views import Shown, draw_views
from edgemap.simulation.world import build_scene

# What a label file asks a detector for; boxes.json has the rest as well.
MINIMUM_VISIBLE, MINIMUM_SIDE_PX = 0.2, 12
FORMAT = "edgemap.pictures/1"


def render_pictures(
    folder: Path,
    per_home: int,
    homes: range,
    progress: Progress = lambda _done, _all: None,
    command: str = "edgemap simulate",
    close: float = 0.0,
    carried: bool = False,
) -> None:
    """Render that many views of every home, a share `close` of them with little floor in view, by a robot's camera
    or a carried one; finished homes are kept, and the result is the same however often it was stopped. Raises
    SimulationError and DiskError."""
    settings = {"format": FORMAT, "per_home": per_home, "first_home": homes[0], "homes": len(homes)}
    settings |= {"home_step": homes.step} if homes.step > 1 else {}
    settings |= {"close": close} if close else {}
    settings |= {"carried": True} if carried else {}
    store = PartStore(folder, settings, ("images", "labels", "floor"))
    if store.complete:
        progress(per_home * len(homes), per_home * len(homes))
        return

    def make(missing: list[int]) -> Iterable[int]:
        tasks = [(folder, home, per_home, close, carried) for home in missing]
        return ordered(_render_home, tasks) if len(tasks) > 1 else map(_render_home, tasks)

    parts = store.fill(homes, make, progress, per_home)
    write_atomically(
        folder / "boxes.json", json.dumps({"frames": [frame for part in parts for frame in part["frames"]]})
    )
    keys = sorted({key for part in parts for key in part["models"]})
    write_atomically(folder / "README.md", credits_text([furniture.model_of(key) for key in keys], command, PICTURES))
    store.finish()


def _render_home(task: tuple[Path, int, int, float, bool]) -> int:
    """Furnish, light and show one home; its part file comes last, and only with it the home counts as made."""
    folder, home, per_home, close, carried = task
    apartment = furnish(home)
    lit = bake(build_scene(apartment, home), home, BakeSettings.draft())
    views = draw_views(apartment, home, per_home, close, carried)
    renderer = Renderer(lit, views[0].camera.intrinsics)
    frames, digits = [], max(2, len(str(per_home - 1)))  # in order of their names
    for number, shown in enumerate(views):
        rng = np.random.default_rng([home, number, 7])
        mount = shaken(shown.camera.mount, shown.effects.shake_rad, shown.velocity, rng)
        mix, gain = _light(shown, lit.probes, rng)
        view, lens = View.of_base(shown.pose_home_base, mount), shown.camera.intrinsics
        renderer.use_lens(lens)
        movers = [mover for mover, _ in shown.passers]
        frame = renderer.frame(view, mix, EXPOSURE * gain, movers)
        boxes = picture_boxes(renderer, frame, view, apartment, movers)
        picture = sensed(frame, lens, optical_twist(shown.velocity, mount), shown.effects, gain, rng)
        name = f"{home:06d}_{number:0{digits}d}"
        _write(folder, name, encoded(picture, shown.effects.jpeg_quality), boxes, lens)
        labels = floor_labels(frame, view, lens, apartment.plan.height_m)
        write_atomically(folder / "floor" / f"{name}.png", png(labels))
        frames.append(boxes)
    renderer.close()
    models = {item.model.key for item in apartment.furniture} | {key for shown in views for _, key in shown.passers}
    part = {"frames": frames, "models": sorted(models)}
    write_atomically(PartStore.part_of(folder, home), json.dumps(part))
    return home


def _light(shown: Shown, probes: Probes, rng: np.random.Generator) -> tuple[LightMix, float]:
    """Light at some moment, and how far the camera brightens it, more or less."""
    mix = light_mix(shown.light, rng.uniform(0.0, 60.0))
    day, lamp = light_levels(probes, shown.pose_home_base.vector()[None])
    return mix, float(settled_gain(mix.day * day + mix.lamp * lamp)[0] * np.exp(rng.normal(0.0, 0.2)))


def _write(folder: Path, name: str, picture: tuple[bytes, str], boxes: list[dict[str, Any]], lens: Any) -> None:
    write_atomically(folder / "images" / (name + picture[1]), picture[0])
    wanted = [
        (COCO_NAMES.index(record["label"]), record["box"])
        for record in boxes
        if record["label"] in COCO_NAMES and is_visible(record, MINIMUM_SIDE_PX, MINIMUM_VISIBLE)
    ]
    write_yolo_labels(folder / "labels" / f"{name}.txt", wanted, lens.width, lens.height)
