"""Records a simulated drive with its truth as a drive folder that the runtime reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.drives.write import write_drive
from edgemap.runtime.trajectory import Trajectory
from edgemap.simulation.apartment.apartment import Apartment, furnish
from edgemap.simulation.errors import SimulationError, require
from edgemap.simulation.render.light import bake
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.view import View
from edgemap.simulation.robot.drive import wheel_odometry
from edgemap.simulation.truth import object_records, picture_boxes
from edgemap.simulation.world import CameraSetup, build_scene, plan_drive

EXPOSURE = 1.9


@dataclass(frozen=True, slots=True)
class Recording:
    """What was recorded: the room, the base's poses in it, and the boxes of every picture."""

    apartment: Apartment
    poses_room_base: list[SE2]
    boxes: list[list[dict[str, Any]]]


def record(
    seed: int,
    frames: int,
    folder: str | Path,
    video: bool = True,
    camera: CameraSetup | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Recording:
    """Furnish, light and drive through the room of a seed; write pictures and truth to a drive folder.

    Pictures go to `video.mp4` (MPEG-4) or `images/000000.png` ...; truth as `write_drive` documents, in the frame of
    the first pose. Raises SimulationError and MissingExtraError, one line each, where something is missing.
    """
    camera, folder = camera or CameraSetup(), Path(folder)
    for module in ("moderngl", "embreex", "PIL"):
        require(module)
    apartment = furnish(seed)
    poses = plan_drive(apartment, camera, frames, seed)
    renderer = Renderer(bake(build_scene(apartment, seed), seed), camera.intrinsics, EXPOSURE)
    folder.mkdir(parents=True, exist_ok=True)
    save, close = _video(folder, camera) if video else _images(folder)
    boxes = []
    for index, pose in enumerate(poses):
        view = View.of_base(pose, camera.mount)
        save(index, renderer.picture(view))
        boxes.append(picture_boxes(renderer, view, apartment))
        progress(index)
    close()
    renderer.close()
    stamps = np.arange(frames) / camera.rate_hz
    truth = Trajectory(stamps, tuple(poses)).from_start()
    believed = wheel_odometry(poses, np.random.default_rng([seed, 3]))
    wheel = [(stamp, pose.x_m, pose.y_m, pose.yaw_rad) for stamp, pose in zip(stamps, believed, strict=True)]
    objects = object_records(apartment, poses[0], boxes)
    write_drive(folder, camera.intrinsics, camera.mount, camera.rate_hz, truth, objects, boxes, wheel)
    return Recording(apartment, poses, boxes)


_Sink = tuple[Callable[[int, np.ndarray], None], Callable[[], None]]


def _video(folder: Path, camera: CameraSetup) -> _Sink:
    path = folder / "video.mp4"
    size = (camera.intrinsics.width, camera.intrinsics.height)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), camera.rate_hz, size)
    if not writer.isOpened():
        raise SimulationError(f"{path}: OpenCV cannot write MPEG-4 video here")

    def save(_: int, image: np.ndarray) -> None:
        writer.write(image)

    return save, writer.release


def _images(folder: Path) -> _Sink:
    (folder / "images").mkdir(exist_ok=True)

    def save(index: int, image: np.ndarray) -> None:
        path = folder / "images" / f"{index:06d}.png"
        if not cv2.imwrite(str(path), image):
            raise SimulationError(f"{path}: cannot be written")

    return save, lambda: None
