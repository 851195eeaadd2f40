"""Documents, tables and whole drive folders: valid ones, mutated; what is accepted is used as the commands use it."""

import json
import math
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import yaml

from edgemap.bridges.ros2.recordings.facts import read_facts, read_trajectory_file
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects import queries
from edgemap.geometry.objects.merge import merge_maps
from edgemap.geometry.registration.alignment import align
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.class_names import COCO_NAMES
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.trajectory import read_tum
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.inputs.drives.pose_files import read_matrices, read_stamps, read_tum_3d
from edgemap.runtime.inputs.drives.sensor_csv import read_imu_csv, read_wheel_csv
from edgemap.runtime.inputs.drives.truth import read_boxes, read_objects
from edgemap.runtime.inputs.drives.yolo import label_table
from edgemap.runtime.outputs.mapfiles.geojson import geojson_text
from edgemap.runtime.outputs.mapfiles.grid import grid_of
from edgemap.runtime.outputs.mapfiles.nav2 import vector_text
from edgemap.runtime.outputs.mapfiles.table import csv_text
from edgemap.runtime.outputs.sightings_file import read_sightings
from edgemap.runtime.step.config import Config, config_document, load_config
from edgemap.runtime.step.edit_queue import load_edits
from edgemap.runtime.step.map_file import load_annotated_map, save_map
from reliability.mutations import json_bytes, mutated_bytes, mutated_rows, mutated_tree
from reliability.workers import ReaderCase, from_file

OBJECTS = [
    {
        "id": f"chair-{i}", "label": "chair", "x_m": i / 2, "y_m": -1.0,
        "covariance_m2": [[0.01, 0.001], [0.001, 0.02]], "width_m": 0.5, "height_m": 0.9,
        "count": 7, "confidence": 0.9, "first_seen_s": 0.5, "last_seen_s": 3.0 + i,
    }
    for i in range(1, 4)
]  # fmt: skip
MAP = {"format": "edgemap.map/1", "frame": "map", "objects": OBJECTS, "seen_from_m": {"chair-1": [[0.0, 1.0]]}}
CAMERA = {
    "width": 64, "height": 48, "fx": 58.7, "fy": 58.75, "cx": 31.5, "cy": 23.5, "fps": 10.0, "world_up": "z",
    "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0.001, 0.0, 0.02]},
    "mount": {"height_m": 0.6, "pitch_deg": 11.5, "roll_deg": 0.5, "forward_m": 0.15, "left_m": 0.0},
    "calibration": {"intrinsics": {"pictures": 20, "rms_px": 0.2}},
}  # fmt: skip
TRUTH = {
    "id": 1, "label": "chair", "x_m": 1.0, "y_m": 2.0, "on_floor": True, "footprint_m": [[0.1, 0.2], [0.3, 0.4]],
    "width_m": 1.0, "depth_m": 0.5, "height_m": 0.8, "visible_frames": 50,
}  # fmt: skip
BOX = {"id": 25, "label": "refrigerator", "box": [37.7, 0.0, 47.0, 19.0], "visible": 0.5}
SEEN = [{"label": "chair", "object": f"chair-{i}", "map_m": [1.0, i / 2]} for i in range(3)]
EDITS = [
    {"frames": 3, "do": "rename", "id": "chair-1", "name": "mine"},
    {"frames": 5, "do": "zone", "name": "desk", "corners_m": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]},
    {"frames": 9, "do": "pose", "pose": [1.0, 2.0, 0.5], "sigmas": [0.1, 0.1, 0.05]},
]
FACTS = {"camera": "test", "rate_hz": 10.0, "intrinsics": None, "format": "edgemap.recording/1"}
FACTS |= {"mount": {"height_m": 0.6, "pitch_rad": 0.2, "roll_rad": 0.0, "forward_m": 0.1, "left_m": 0.0}}
RUN: dict[str, Any] = {"options": {"camera": "demo", "frames": 9, "view": True}, "config": config_document(Config())}
SHORT_RUN = RUN | {"config": {name: RUN["config"][name] for name in ("floor", "rest", "grid")}}
YAML_TEXTS = (
    "!!python/object:os.system ", "!!int ", "&a ", "*a ", "!!binary ", "<<: ", "? ", "2026-01-01", "- " * 50, "\t",
)  # fmt: skip
TUM = "".join(f"{i / 10} {i / 20} {i / 50} 0 0 0 {np.sin(i / 40):.9f} {np.cos(i / 40):.9f}\n" for i in range(12))
WHEEL = "stamp_s,x_m,y_m,yaw_rad\n" + "".join(f"{i / 10},{i / 20},{i / 50},{i / 30}\n" for i in range(12))
IMU = "stamp_s,gx,gy,gz,ax,ay,az\n" + "".join(f"{i / 200},0.01,-0.02,0.1,0.2,9.8,{i / 9}\n" for i in range(12))
KITTI = "".join(f"0 0 1 {i} -1 0 0 0 0 -1 0 1\n" for i in range(5))
C2W = KITTI.replace("0 1\n", "0 1 0 0 0 1\n")
LABELS = "56 0.5 0.5 0.25 0.5\n0 0.1 0.2 0.1 0.1\n"
EUROC = "%YAML:1.0\nT_BS: {data: [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]}\nresolution: [64, 48]\n"
EUROC += "intrinsics: [60.0, 60.0, 32.0, 24.0]\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 1e-5]\n"
NS = 1_400_000_000_000_000_000
PICTURE = cv2.imencode(".png", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def document_cases() -> list[ReaderCase]:
    """Every text format."""
    boxes, rows = {"frames": [[BOX, BOX | {"id": 2}], [], [BOX]]}, [[i / 10, i / 20, 0.1, 0.2] for i in range(5)]
    return [
        _json("map.json", MAP, _use_map, "map.json"),
        _json("objects.json", {"objects": [TRUTH, TRUTH | {"id": 2}]}, read_objects, "objects.json"),
        _json("boxes.json", boxes, read_boxes, "boxes.json"),
        _lines("sightings.jsonl", SEEN, lambda path: read_sightings(path.parent)),
        _lines("edits.jsonl", EDITS, load_edits),
        _json("trajectory attachment", rows, lambda path: read_trajectory_file(path.read_bytes(), "a.mcap"), "a.json"),
        ReaderCase("recording's facts", _facts, lambda _, record: read_facts(record, "a.mcap")),
        _json("config, JSON", RUN, _use_config, "run.json"),
        ReaderCase("config, YAML", lambda random: _yaml(random, SHORT_RUN), from_file("run.yaml", _use_config)),
        ReaderCase("camera.yaml", lambda random: _yaml(random, CAMERA), from_file("camera.yaml", read_camera_yaml)),
        _rows("wheel.csv", WHEEL, read_wheel_csv),
        _rows("imu.csv", IMU, read_imu_csv),
        _rows("TUM, planar", TUM, read_tum),
        _rows("TUM, 3-D", TUM, read_tum_3d),
        _rows("poses.txt, KITTI", KITTI, lambda path: read_matrices(path, 12)),
        _rows("poses.txt, c2w", C2W, lambda path: read_matrices(path, 16)),
        _rows("times.txt", "0.0\n0.1\n0.2\n1e0\n", read_stamps),
        _rows("yolo labels", LABELS, lambda path: label_table(COCO_NAMES).read(path, CameraError)),
        ReaderCase("folders of drives", _drive, _use_drive),
    ]


def _json(name: str, tree: Any, read: Callable[[Path], object], file: str) -> ReaderCase:
    return ReaderCase(name, lambda random: json_bytes(random, tree), from_file(file, read))


def _rows(name: str, text: str, read: Callable[[Path], object]) -> ReaderCase:
    return ReaderCase(name, lambda random: mutated_rows(random, text.encode()), from_file("rows.txt", read))


def _lines(name: str, records: list[Any], read: Callable[[Path], object]) -> ReaderCase:
    """A file of one JSON record on each line, one of them mutated."""

    def make(random: Random) -> bytes:
        lines = [json.dumps(record).encode() for record in records]
        chosen = random.randrange(len(lines))
        lines[chosen] = json_bytes(random, records[chosen])
        return b"\n".join(lines) + b"\n" * random.randrange(2)

    return ReaderCase(name, make, from_file(name, read))


def _yaml(random: Random, tree: Any) -> bytes:
    if random.random() < 0.5:
        return json_bytes(random, tree)  # JSON is YAML, nearly
    flow = random.choice((None, True, False))
    text = yaml.safe_dump(mutated_tree(random, tree), default_flow_style=flow, allow_unicode=True)
    if random.random() < 0.4:
        at = random.choice([i for i, letter in enumerate(text) if letter in " \n"] or [0]) + 1
        text = text[:at] + random.choice(YAML_TEXTS) + text[at:]
    data = text.encode(errors="surrogatepass")
    return mutated_bytes(random, data) if random.random() < 0.1 else data


def _facts(random: Random) -> dict[str, str]:
    record = mutated_tree(random, FACTS)
    record = record if isinstance(record, dict) else {}
    return {str(name): value if isinstance(value, str) else json.dumps(value) for name, value in record.items()}


def _use_config(path: Path) -> None:
    config_document(load_config(path))


def _use_map(path: Path) -> None:
    """Save, query, export and align it as `edgemap map` does."""
    objects, annotations = load_annotated_map(path)
    for item in (*objects, *annotations.deleted):
        assert np.all(np.isfinite(item.position_m))
        assert np.all(np.linalg.eigvalsh(item.covariance_m2) > 0.0)
        assert item.last_seen_s >= item.first_seen_s
    save_map(path.with_name("again.json"), objects, annotations)
    again, _ = load_annotated_map(path.with_name("again.json"))
    assert [item.id for item in again] == [item.id for item in objects]
    if objects:
        queries.nearest(objects, (0.0, 0.0))
    queries.inside_polygon(objects, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for text in (geojson_text(objects), csv_text(objects)):
        text.encode()
    for export in (vector_text, grid_of, lambda found: merge_maps(found, again, align(found, again))):
        with suppress(EdgemapError):  # a map may be too large for a grid, and too small to be aligned with another
            export(objects)


# Whole folders: every layout, one or two of its files mutated or missing.

_BOXES = json.dumps({"frames": [[BOX]] * 5})
_STAMPS = "".join(f"{i / 10}\n" for i in range(5))
_POSES = "".join(line + "\n" for line in TUM.splitlines()[:5])
_FLIGHT = {
    "cam0.yaml": EUROC,
    "imu.yaml": EUROC,
    "imu.csv": "".join(f"{NS + 10_000_000 * i},0.01,0,0,0,0,9.8\n" for i in range(30)),
    "truth.txt": "".join(f"{NS + 50_000_000 * i} {i / 20} 0 0 0 0 0 1\n" for i in range(6)),
}
DRIVES: dict[str, tuple[str, dict[str, str]]] = {
    "kitti": ("image", {"poses.txt": KITTI, "times.txt": _STAMPS}),
    "tum": ("rgb", {"poses.tum": _POSES}),
    "c2w": ("image", {"poses.txt": C2W, "K.txt": "60 0 32\n0 60 24\n0 0 1\n"}),
    "drive": ("images", {"poses.tum": _POSES, "wheel.csv": WHEEL, "imu.csv": IMU, "boxes.json": _BOXES}),
    "locobot": ("rgb", {"odometry.csv": "".join(line + "\n" for line in WHEEL.splitlines()[:6])}),
    "yolo": ("images", {f"labels/{i}.txt": LABELS for i in range(5)}),
    "euroc": ("image", _FLIGHT),
}


def _drive(random: Random) -> tuple[str, dict[str, bytes]]:
    kind = random.choice([*DRIVES])
    place, texts = DRIVES[kind]
    files = {name: text.encode() for name, text in texts.items()} | {"camera.yaml": json.dumps(CAMERA).encode()}
    files["objects.json"] = json.dumps({"objects": [TRUTH]}).encode()
    for number in range(5):
        files[f"{place}/{NS + 50_000_000 * number if kind == 'euroc' else number}.png"] = PICTURE
    for name in random.sample([*files], random.choice((0, 1, 1, 2))):
        data = files.pop(name)
        if random.random() < 0.8:
            text = name.endswith((".txt", ".tum", ".csv"))
            files[name] = mutated_rows(random, data) if text else mutated_bytes(random, data)
        elif random.random() < 0.5:
            files[random.choice(("x.png", "9" * 19 + ".png", "a\x1bb.png", "²"))] = data
    return kind, files


def _use_drive(folder: Path, drawn: tuple[str, dict[str, bytes]]) -> None:
    kind, files = drawn
    place = folder / "drive"
    shutil.rmtree(place, ignore_errors=True)
    for name, data in files.items():
        (place / name).parent.mkdir(exist_ok=True, parents=True)
        (place / name).write_bytes(data)
    drive = open_drive(f"{kind}:{place}")
    assert len(drive.stamps_s) == len(drive.images)
    assert np.all(np.diff(drive.stamps_s) > 0.0)
    assert drive.rate_hz is None or (math.isfinite(drive.rate_hz) and drive.rate_hz > 0.0)
    if drive.truth is not None:
        assert np.all(np.isfinite([pose.vector() for pose in drive.truth.poses]))
    drained(drive_camera(drive, "fuzz"))


def drained(camera: Camera) -> None:
    """Reads at most fifty frames and closes the camera; faults are what a run continues after."""
    last_s = -math.inf
    with camera:
        for _ in range(50):
            with suppress(CameraFault):
                if (frame := camera.read()) is None:
                    return
                assert frame.image.dtype == np.uint8
                assert frame.stamp_s >= last_s
                last_s = frame.stamp_s
