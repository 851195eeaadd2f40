import cv2
import numpy as np
import pytest
from support import painted

CAMERA_YAML = """{width: 64, height: 64, fx: 50.0, fy: 50.0, cx: 31.5, cy: 31.5, fps: 10.0,
 distortion: {model: none, coefficients: []}, world_up: z,
 mount: {height_m: 1.0, pitch_deg: 0.0, roll_deg: 0.0, forward_m: 0.0, left_m: 0.0}}
"""


@pytest.fixture(scope="session")
def painted_bundle(tmp_path_factory):
    """A bundle that sees a chair 5 m ahead and a person, whatever the picture."""
    scene = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9), ("person", 10.0, 40.0, 8.0, 20.0, 0.8)]
    return painted.write_painted(tmp_path_factory.mktemp("painted") / "bundle", scene, odometry=False)


@pytest.fixture
def pictures(tmp_path):
    """A folder of 12 pictures of one scene, 64x64, with a camera.yaml."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    scene = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    for index in range(12):
        cv2.imwrite(str(folder / f"{index}.png"), scene)
    (folder / "camera.yaml").write_text(CAMERA_YAML)
    return folder
