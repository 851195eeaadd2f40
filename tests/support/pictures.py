"""Pictures that a painted bundle maps, of one scene and of a drive round a room; the start of the demo as a video."""

import math
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from edgemap.runtime.inputs.open import open_camera

CAMERA_YAML = """{width: 64, height: 64, fx: 50.0, fy: 50.0, cx: 31.5, cy: 31.5, fps: 10.0,
 distortion: {model: none, coefficients: []}, world_up: z,
 mount: {height_m: 1.0, pitch_deg: 0.0, roll_deg: 0.0, forward_m: 0.0, left_m: 0.0}}
"""


def noise(index: int, shape: tuple[int, ...] = (64, 64, 3)) -> np.ndarray:
    """Noise, (H, W, 3) uint8: it shows nothing, but nobody takes it for a covered lens or a frozen camera."""
    return np.random.default_rng(index).integers(0, 255, shape, dtype=np.uint8)


def write_pictures(folder: Path, count: int, size: tuple[int, int] = (48, 64)) -> None:
    """`0.png` and so on, (H, W), each in the grey of its number."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((*size, 3), number, np.uint8))


def write_scene(folder: Path) -> Path:
    """The folder `pictures` in this one, made."""
    made = folder / "pictures"
    made.mkdir()
    scene = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    for index in range(12):
        cv2.imwrite(str(made / f"{index}.png"), scene)
    (made / "camera.yaml").write_text(CAMERA_YAML)
    return made


STATIONS = ((0.0, 0.0, 0.0), (0.3, 0.5, 0.9), (-0.4, 0.3, 2.2), (0.2, -0.6, 3.6), (0.6, 0.1, 5.1))  # x, y, yaw


def write_round(folder: Path, rounds: int = 1) -> list[str | Path]:
    """Eight pictures at each of five poses, so often: what is seen 5 m ahead stands at five places. The options of
    `edgemap run` for it."""
    made, random, lines = folder / "round", np.random.default_rng(0), []
    made.mkdir()
    (made / "camera.yaml").write_text(CAMERA_YAML)
    for index in range(40 * rounds):
        x, y, yaw = STATIONS[index // 8 % 5]
        lines.append(f"{index / 10:.1f} {x} {y} 0 0 0 {math.sin(yaw / 2)} {math.cos(yaw / 2)}\n")
        if index < 40:
            cv2.imwrite(str(made / f"{index:05d}.png"), random.integers(0, 255, (64, 64, 3), dtype=np.uint8))
        else:
            (made / f"{index:05d}.png").symlink_to(made / f"{index % 40:05d}.png")
    (folder / "round.tum").write_text("".join(lines))
    return ["--camera", made, "--odometry", folder / "round.tum"]


def write_video(path: Path, count: int = 12) -> None:
    """The demo's first pictures as a video."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (640, 480))
    with open_camera("demo") as demo:
        for frame in islice(iter(demo.read, None), count):
            video.write(frame.image)
    video.release()
