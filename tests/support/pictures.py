"""Twelve pictures of one scene with a camera.yaml: the smallest drive that a painted bundle maps."""

from pathlib import Path

import cv2
import numpy as np

CAMERA_YAML = """{width: 64, height: 64, fx: 50.0, fy: 50.0, cx: 31.5, cy: 31.5, fps: 10.0,
 distortion: {model: none, coefficients: []}, world_up: z,
 mount: {height_m: 1.0, pitch_deg: 0.0, roll_deg: 0.0, forward_m: 0.0, left_m: 0.0}}
"""


def write_scene(folder: Path) -> Path:
    """The folder `pictures` in this one, made."""
    made = folder / "pictures"
    made.mkdir()
    scene = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    for index in range(12):
        cv2.imwrite(str(made / f"{index}.png"), scene)
    (made / "camera.yaml").write_text(CAMERA_YAML)
    return made
