"""Records a simulated drive as a folder that the runtime reads: pictures or a video, poses, sensors, truth."""

import json
import math
from collections.abc import Iterable
from contextlib import closing
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.frame import png
from edgemap.runtime.frames.reading import library_path
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, write_drive, write_locobot
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.sensor_csv import write_imu_csv
from edgemap.runtime.inputs.drives.truth import PLAN_FORMAT, PLAN_NAME
from edgemap.simulation.apartment.credits import credits_text
from edgemap.simulation.apartment.layout import Placed
from edgemap.simulation.apartment.plan import Rectangle
from edgemap.simulation.apartment.space import rectangle_corners
from edgemap.simulation.render.light import BakeSettings
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.imu import imu_samples, wheel_odometry
from edgemap.simulation.shots import shots
from edgemap.simulation.store import PartStore, Progress
from edgemap.simulation.studio import Shot, Studio, lit_home
from edgemap.simulation.truth import object_records
from edgemap.simulation.world import World

QUALITY_CRF = 32  # VP9's constant quality: some 6 kB a picture of 640x480 that hardly shows it


def write_video(path: Path, pictures: Iterable[NDArray[np.uint8]], rate_hz: float) -> None:
    """Encode BGR pictures (H, W, 3) of one size, sides even; one thread, so that the bytes depend on them alone.

    Raises MissingExtraError where PyAV is absent.
    """
    need("simulation", "a video", ("av",))
    import av

    with av.open(library_path(path), "w", format="mp4") as container:
        stream = container.add_stream("libvpx-vp9", rate=Fraction(rate_hz).limit_denominator(1000))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": str(QUALITY_CRF), "b": "0", "cpu-used": "2"}
        stream.thread_count = 1
        for index, picture in enumerate(pictures):
            if index == 0:
                stream.height, stream.width = picture.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())


def label_drive(world: World, folder: Path, every: int) -> int:
    """Writes the missing labels of every `every`-th picture of a world's drive. Returns their number. They do not
    depend on the light, so draft lighting suffices. Raises CameraError where the folder holds no pictures.
    """
    chosen = list(enumerate(list_pictures(folder / "images")))[:: max(every, 1)]
    files = [(index, folder / "floor" / f"{path.stem}.png") for index, path in chosen]
    missing = [(index, file) for index, file in files if not file.is_file()]
    if missing:
        (folder / "floor").mkdir(exist_ok=True)
        with closing(Studio(world, lit_home(world, BakeSettings.draft()))) as studio:
            for index, file in missing:
                write_atomically(file, png(studio.floor_labels(index)))
    return len(files)


def write_floor_plan(world: World, folder: Path) -> None:
    """Writes `floor_plan.json`, in the map frame, metres. Furniture is its oriented bounding rectangle with its lowest
    and highest point; walls contain open door leaves. Raises DiskError.
    """
    pose_map_home, plan = world.poses()[0].inverse(), world.apartment.plan
    names = [f"room-{number}" for number in range(1, len(plan.rooms) + 1)]

    def corners(points: Array) -> list[list[float]]:
        return np.round(pose_map_home.apply(points), 4).tolist()

    def rectangle(area: Rectangle) -> list[list[float]]:
        return corners(rectangle_corners(area))

    record = {
        "format": PLAN_FORMAT,
        "frame": "map",
        "walls": [{"corners_m": rectangle(wall)} for wall in plan.walls],
        "rooms": [
            {"id": name, "kind": room.kind, "corners_m": rectangle(room.rectangle)}
            for name, room in zip(names, plan.rooms, strict=True)
        ],
        "doorways": [
            {
                "id": f"door-{number}",
                "rooms": [names[room] for room in door.rooms],
                "corners_m": rectangle(door.rectangle),
            }
            for number, door in enumerate(plan.doorways, 1)
        ],
        "footprints": [
            {
                "id": item.id,
                "label": item.label,
                "low_m": round(float(item.z_m), 4),
                "high_m": round(float(item.z_m + item.model.height_m), 4),
                "corners_m": corners(item.footprint_home_m()),
            }
            for item in world.apartment.furniture
        ],
    }
    write_atomically(folder / PLAN_NAME, json.dumps(record) + "\n")


FORMAT = "edgemap.simulation/2"
_MOST_DEPTH_MM = 65535


def truth_of(world: World) -> Trajectory:
    """Poses of the base from the first one, at the pictures' stamps."""
    return Trajectory(world.stamps_s, tuple(world.poses())).from_start()


def record(
    world: World,
    folder: Path,
    *,
    layout: str = "drive",
    video: bool = False,
    depth: bool = False,
    progress: Progress = lambda _done, _all: None,
    command: str = "edgemap simulate",
) -> None:
    """Renders a world's drive to a folder; an interrupted one is resumed, with identical bytes. layout: `drive`
    (images/ or video.mp4; depth/ if asked) or `locobot` (rgb/, depth/). depth: 16 bits, millimetres along the optical
    axis. progress: called with the pictures done and all. Raises SimulationError, DiskError and MissingExtraError.
    """
    locobot = layout == "locobot"
    folders = ([] if video else ["rgb" if locobot else "images"]) + (["depth"] if depth or locobot else [])
    store = PartStore(folder, _settings(world, layout, video, depth), folders)
    if store.complete:
        if not locobot:  # it may have been rendered when plans held less
            write_floor_plan(world, folder)
        progress(world.frames, world.frames)
        return
    pictures = store.parts if video else folder / folders[0]

    def save(shot: Shot) -> None:
        """Saves a picture; its truth is written last and marks the picture as complete."""
        name = f"{shot.index:06d}"
        write_atomically(pictures / (name + shot.suffix), shot.picture)
        if "depth" in folders:
            millimetres = np.clip(shot.depth_m * 1000.0 + 0.5, 0, _MOST_DEPTH_MM).astype(np.uint16)
            write_atomically(folder / "depth" / f"{name}.png", png(millimetres))
        write_atomically(store.part_of(folder, shot.index), json.dumps(shot.boxes))

    boxes = store.fill(range(world.frames), lambda missing: map(save, shots(world, missing)), progress)
    if video:
        unfinished = store.parts / "video.mp4"
        paths = sorted(path for path in pictures.iterdir() if path.suffix in (".png", ".jpg"))
        write_video(unfinished, map(read_picture, paths), world.camera.rate_hz)
        unfinished.replace(folder / "video.mp4")
    camera, truth = world.camera, truth_of(world)
    wheel = wheel_odometry(world.motion, world.stamps_s, np.random.default_rng([world.seed, 3])).tolist()
    described = CameraFile(camera.intrinsics, camera.mount, camera.rate_hz)
    if locobot:
        write_locobot(folder, described, wheel, truth)
    else:
        objects = object_records(world.apartment, world.poses()[0], boxes)
        tilts = None if world.tilts is None else world.tilts.at(world.stamps_s)
        write_floor_plan(world, folder)
        write_drive(folder, described, truth, objects, boxes, wheel, tilts)
        if world.imu:
            rng = np.random.default_rng([world.seed, 9])
            samples = imu_samples(world.motion, world.tilts, camera.mount, float(world.stamps_s[-1]) + 0.1, rng)
            write_imu_csv(folder / "imu.csv", samples)
    if moved := moved_record(world):
        write_atomically(folder / "moved.json", json.dumps(moved, indent=1))
    write_atomically(folder / "README.md", credits_text(world.models(), command))
    store.finish()


def _settings(world: World, layout: str, video: bool, depth: bool) -> dict[str, Any]:
    chosen = {"nodding": world.tilts is not None, "imu": world.imu}
    return (
        {
            "format": FORMAT,
            "seed": world.seed,
            "home_seed": world.home_seed,
            "frames": world.frames,
            "layout": layout,
            "video": video,
            "depth": depth,
            "people": len(world.walkers),
            "effects": asdict(world.effects),
            "light": {**asdict(world.light), "switches_s": list(world.light.switches_s[:8])},
            "height_m": world.camera.mount.height_m,
            "pitch_rad": world.camera.mount.pitch_rad,
            "focal_px": world.camera.intrinsics.fx,
        }
        | {name: True for name, wanted in chosen.items() if wanted}
        | ({"moved": len(world.changes.moved)} if world.changes else {})
    )


def moved_record(world: World) -> dict[str, Any]:
    """Pieces removed and moved, with ids as in objects.json, and the new drive's `start` (x m, y m, yaw degrees): all
    in the start-pose frame of the seed's own drive, which is what its map is in. Empty where nothing was moved."""
    if world.changes is None or world.start_before is None:
        return {}
    pose_before_home = world.start_before.inverse()
    start = pose_before_home @ world.poses()[0]

    def place(item: Placed) -> list[float]:
        return [round(x, 4) for x in pose_before_home.apply(item.middle_home_m).tolist()]

    def former(item: Placed) -> dict[str, Any]:
        return {"id": item.id, "label": item.label, "was_m": place(item)}

    return {
        "frame": "start pose of the drive before",
        "start": [round(start.x_m, 4), round(start.y_m, 4), round(math.degrees(start.yaw_rad), 4)],
        "removed": [former(item) for item in world.changes.removed],
        "moved": [former(old) | {"is_m": place(new)} for old, new in world.changes.moved],
    }
