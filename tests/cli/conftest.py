import json
import shutil

import numpy as np
import pytest
from support import painted
from support.pictures import write_scene


@pytest.fixture(scope="session")
def painted_bundle(floorless_bundle, tmp_path_factory):
    """The same with floor everywhere: else a companion would search noise for it."""
    folder = shutil.copytree(floorless_bundle, tmp_path_factory.mktemp("painted") / "bundle")
    return painted.with_floor(folder, np.ones((1, 1, 8, 8)), 8)


@pytest.fixture
def pictures(tmp_path):
    """A folder of 12 pictures of one scene, 64x64, with a camera.yaml."""
    return write_scene(tmp_path)


@pytest.fixture
def known_drive(pictures):
    """The twelve pictures as a drive that stands still before a chair (which the painted bundle sees) and a couch."""
    (pictures / "images").mkdir()
    for path in pictures.glob("*.png"):
        path.rename(pictures / "images" / path.name)
    (pictures / "poses.tum").write_text("".join(f"{index / 10:.1f} 0 0 0 0 0 0 1\n" for index in range(12)))
    footprint = [[5.0, -1.1], [5.5, -1.1], [5.5, -0.6], [5.0, -0.6]]
    common = {"on_floor": True, "footprint_m": footprint, "width_m": 0.5, "depth_m": 0.5, "height_m": 0.9}
    common |= {"visible_frames": 12}
    chair = {"id": 1, "label": "chair", "x_m": 5.25, "y_m": -0.84}
    couch = {"id": 2, "label": "couch", "x_m": 1.0, "y_m": 2.0}
    (pictures / "objects.json").write_text(json.dumps({"objects": [chair | common, couch | common]}))
    return pictures
