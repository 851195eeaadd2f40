"""Floor labels beside a rendered drive's pictures, `floor/NAME.png`: what `eval floor` and `train floor` read."""

from pathlib import Path

import cv2

from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.simulation.render.light import BakeSettings
from edgemap.simulation.store import write_bytes
from edgemap.simulation.studio import Studio, lit_home
from edgemap.simulation.world import World


def label_drive(world: World, folder: Path, every: int) -> int:
    """Writes the missing labels of every `every`-th picture of a world's drive. Returns their number. They do not
    depend on the light, so draft lighting suffices. Raises CameraError where the folder holds no pictures.
    """
    chosen = list(enumerate(list_pictures(folder / "images")))[:: max(every, 1)]
    files = [(index, folder / "floor" / f"{path.stem}.png") for index, path in chosen]
    missing = [(index, file) for index, file in files if not file.is_file()]
    if missing:
        (folder / "floor").mkdir(exist_ok=True)
        studio = Studio(world, lit_home(world, BakeSettings.draft()))
        try:
            for index, file in missing:
                write_bytes(file, cv2.imencode(".png", studio.floor_labels(index))[1].tobytes())
        finally:
            studio.close()
    return len(files)
