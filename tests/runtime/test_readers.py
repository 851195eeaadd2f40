"""Every reader of a file: a valid file with something wrong in it is read to valid values, or refused in one line."""

import io
import json
import math
import os
import shutil
import tracemalloc
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from support.mutations import (
    MUTATED,
    drained,
    mutated_bytes,
    mutated_json,
    mutated_lines,
    mutated_rows,
    mutated_tree,
    refused_or,
)
from support.refusal import refused

from edgemap.calibrate.stated_focal import stated_focal_px
from edgemap.geometry.errors import EdgemapError, MapError
from edgemap.geometry.objects import queries
from edgemap.geometry.objects.merge import merge_maps
from edgemap.geometry.registration.alignment import align
from edgemap.runtime.frames.class_names import read_class_names
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line, read_bytes
from edgemap.runtime.frames.trajectory import Trajectory, trajectory_of
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml
from edgemap.runtime.inputs.drives.lens_files import read_foreign_lens
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.pose_files import read_matrices, read_stamps, read_tum_3d
from edgemap.runtime.inputs.drives.sensor_csv import read_imu_csv, read_wheel_csv
from edgemap.runtime.inputs.drives.truth import read_boxes, read_objects
from edgemap.runtime.inputs.drives.yolo import COCO_NAMES, label_table
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.grid import grid_of
from edgemap.runtime.outputs.map_formats.nav2 import vector_text
from edgemap.runtime.outputs.map_formats.table import csv_text
from edgemap.runtime.outputs.sightings_file import read_sightings
from edgemap.runtime.step.config import Config, load_config
from edgemap.runtime.step.edit_queue import load_edits
from edgemap.runtime.step.grid_file import load_grid, read_grid
from edgemap.runtime.step.map_file import load_annotated_map, save_map

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
TUNING = msgspec.to_builtins(Config())
TUNING = {"config": {name: TUNING[name] for name in ("floor", "rest")}, "options": {"camera": "demo"}}
TUM = "".join(f"{i / 10} {i / 20} {i / 50} 0 0 0 {np.sin(i / 40):.9f} {np.cos(i / 40):.9f}\n" for i in range(12))
WHEEL = "stamp_s,x_m,y_m,yaw_rad\n" + "".join(f"{i / 10},{i / 20},{i / 50},{i / 30}\n" for i in range(12))
IMU = "stamp_s,gx,gy,gz,ax,ay,az\n" + "".join(f"{i / 200},0.01,-0.02,0.1,0.2,9.8,{i / 9}\n" for i in range(12))
KITTI = "".join(f"0 0 1 {i} -1 0 0 0 0 -1 0 1\n" for i in range(5))
C2W = KITTI.replace("0 1\n", "0 1 0 0 0 1\n")
BOXES, LABELS = label_table(COCO_NAMES), "56 0.5 0.5 0.25 0.5\n0 0.1 0.2 0.1 0.1\n"
YAML_TEXTS = ("!!python/object:os.system ", "!!int ", "&a ", "*a ", "!!binary ", "<<: ", "? ", "2026-01-01", "- " * 50)


@dataclass(frozen=True)
class ReaderCase:
    """A reader, a strategy of mutated files for it, and the file's name."""

    file: str
    inputs: st.SearchStrategy[bytes]
    read: Callable[[Path], Any]


@st.composite
def mutated_yaml(draw, tree) -> bytes:
    if draw(st.booleans()):
        return draw(mutated_json(tree))  # JSON is YAML, nearly
    text = yaml.safe_dump(draw(mutated_tree(tree)), default_flow_style=draw(st.sampled_from((None, True, False))))
    if draw(st.booleans()):
        at = draw(st.sampled_from([i for i, letter in enumerate(text) if letter in " \n"] or [0])) + 1
        text = text[:at] + draw(st.sampled_from(YAML_TEXTS)) + text[at:]
    return text.encode(errors="surrogatepass")


def finite(*values) -> None:
    assert all(np.isfinite(np.asarray(value, dtype=np.float64)).all() for value in values)


def use_map(path: Path) -> None:
    """Save, query, export and align it as `edgemap map` does."""
    objects, annotations = load_annotated_map(path)
    for item in (*objects, *annotations.deleted):
        finite(item.position_m, item.width_m, item.height_m, item.confidence)
        assert np.abs(item.position_m).max() <= 1e6
        assert np.linalg.eigvalsh(item.covariance_m2)[0] > 0.0
        assert item.last_seen_s >= item.first_seen_s
        assert item.label.isprintable()
    save_map(path.with_name("again.json"), objects, annotations)
    again, _ = load_annotated_map(path.with_name("again.json"))
    assert [item.id for item in again] == [item.id for item in objects]
    if objects:
        queries.nearest(objects, (0.0, 0.0))
    queries.inside_polygon(objects, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for text in (geojson_text(objects), csv_text(objects)):
        text.encode()
    for export in (vector_text, grid_of, lambda read: merge_maps(read, again, align(read, again))):
        with suppress(EdgemapError):  # a map may be too large for a grid, and too small to be aligned with another
            export(objects)


def use_camera_file(path: Path) -> CameraFile:
    camera = read_camera_yaml(path)
    lens = camera.intrinsics
    finite(lens.fx, lens.fy, lens.cx, lens.cy, lens.distortion.coefficients)
    if camera.mount is not None:
        finite(camera.mount.height_m, camera.mount.pitch_rad, camera.mount.roll_rad)
        assert 0.0 < camera.mount.height_m <= 10.0
    json.dumps(camera.calibration)  # a run keeps it in its run.json
    return camera


def use_config(path: Path) -> None:
    json.dumps(msgspec.to_builtins(load_config(path)), allow_nan=False)


def use_trajectory(trajectory: Trajectory) -> None:
    finite(trajectory.stamps_s, [pose.vector() for pose in trajectory.poses])
    assert (np.diff(trajectory.stamps_s) > 0.0).all()


def use_written(path: Path) -> None:
    if (trajectory := trajectory_of(path)) is not None:
        use_trajectory(trajectory)


def use_imu(path: Path) -> None:
    samples = read_imu_csv(path)
    finite(samples.stamps_s, samples.gyro_rad_s, samples.accel_m_s2)
    assert (np.diff(samples.stamps_s) > 0.0).all()


def use_grid(path: Path) -> None:
    grid = read_grid(path.read_bytes(), "grid.npz")
    assert grid.cells.size
    finite(grid.x_m, grid.y_m, grid.cell_m)
    assert grid.cell_m > 0.0


def use_names(path: Path) -> None:
    assert all(name and name.isprintable() for name in read_class_names(path, CameraError))


def use_picture(path: Path) -> None:
    image = read_picture(path)
    assert image.dtype == np.uint8
    assert image.ndim == 3


GRID = {
    "log_odds": np.arange(-60, 60, dtype=np.int8).reshape(10, 12).tolist(), "origin_m": [-0.5, 1.0],
    "resolution_m": 0.05, "thresholds": [-1.1, 0.6],
}  # fmt: skip


@st.composite
def mutated_grid(draw) -> bytes:
    """A grid's archive of mutated arrays, or damaged bytes of it."""
    tree, data = draw(mutated_tree(GRID)), io.BytesIO()
    arrays = {}
    for name, value in tree.items():
        with suppress(ValueError, TypeError, OverflowError):  # what is no array
            kind = draw(st.sampled_from((np.int8, np.int8, np.float64))) if name == "log_odds" else np.float64
            arrays[name] = np.array(value, kind)
    with suppress(ValueError):  # a name that no archive holds
        draw(st.sampled_from((np.savez, np.savez_compressed)))(data, **arrays)
    return draw(mutated_bytes(data.getvalue())) if draw(st.booleans()) else data.getvalue()


IMAGE = np.random.default_rng(0).integers(0, 255, (12, 17, 3), np.uint8)
IMAGES = {".pgm": IMAGE[:, :, 0]} | dict.fromkeys((".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp"), IMAGE)
PICTURES = [cv2.imencode(suffix, image)[1].tobytes() for suffix, image in IMAGES.items()]


def with_focal_length() -> bytes:
    data, exif = io.BytesIO(), Image.Exif()
    exif[0x8769] = {0xA405: 27}  # FocalLengthIn35mmFilm
    Image.new("RGB", (40, 30)).save(data, "PNG", exif=exif)
    return data.getvalue()


READERS = {
    "map": ReaderCase("map.json", mutated_json(MAP), use_map),
    "grid": ReaderCase("grid.npz", mutated_grid(), use_grid),
    "camera file": ReaderCase("camera.yaml", mutated_yaml(CAMERA), use_camera_file),
    "configuration": ReaderCase("run.yaml", mutated_yaml(TUNING), use_config),
    "run.json": ReaderCase("run.json", mutated_json(TUNING), use_config),
    "edits": ReaderCase("edits.jsonl", mutated_lines(EDITS), load_edits),
    "sightings": ReaderCase("sightings.jsonl", mutated_lines(SEEN), lambda path: read_sightings(path.parent)),
    "true objects": ReaderCase("objects.json", mutated_json({"objects": [TRUTH, TRUTH | {"id": 2}]}), read_objects),
    "true boxes": ReaderCase("boxes.json", mutated_json({"frames": [[BOX, BOX | {"id": 2}], [], [BOX]]}), read_boxes),
    "wheels": ReaderCase("wheel.csv", mutated_rows(WHEEL), lambda path: use_trajectory(read_wheel_csv(path))),
    "IMU": ReaderCase("imu.csv", mutated_rows(IMU), use_imu),
    "trajectory": ReaderCase("trajectory.tum", mutated_rows(TUM), use_written),
    "TUM, 3-D": ReaderCase("a.tum", mutated_rows(TUM), lambda path: finite(*read_tum_3d(path))),
    "KITTI": ReaderCase("poses.txt", mutated_rows(KITTI), lambda path: finite(read_matrices(path, 12))),
    "c2w": ReaderCase("poses.txt", mutated_rows(C2W), lambda path: finite(read_matrices(path, 16))),
    "stamps": ReaderCase("times.txt", mutated_rows("0.0\n0.1\n0.2\n1e0\n"), lambda path: finite(read_stamps(path))),
    "labels": ReaderCase("a.txt", mutated_rows(LABELS), lambda path: finite(BOXES.read(path, CameraError)[1])),
    "focal length": ReaderCase("a.png", mutated_bytes(with_focal_length()), lambda path: stated_focal_px(path, 40, 30)),
    "class names": ReaderCase("data.yaml", mutated_yaml({"path": ".", "names": {0: "chair", 1: "couch"}}), use_names),
    "pictures": ReaderCase("a.png", st.sampled_from(PICTURES).flatmap(mutated_bytes), use_picture),
}


@pytest.mark.parametrize("name", READERS)
@MUTATED
@given(data=st.data())
def test_a_damaged_file_is_read_to_valid_values_or_refused_in_one_line(name, data, tmp_path):
    case = READERS[name]
    path = tmp_path / case.file
    path.write_bytes(data.draw(case.inputs))
    refused_or(case.read, path)


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> bytes:
    path = str(tmp_path_factory.mktemp("video") / "a.mp4")
    writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for shade in range(6):
        writer.write(np.full((48, 64, 3), 40 * shade, np.uint8))
    writer.release()
    return Path(path).read_bytes()


@MUTATED
@given(data=st.data())
def test_a_damaged_video_gives_its_pictures_or_one_line(video, data, tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(data.draw(mutated_bytes(video)))
    refused_or(lambda: drained(open_camera(str(path))))


# Whole folders: every layout, one or two of its files damaged or missing.
NS = 1_400_000_000_000_000_000
EUROC = "%YAML:1.0\nT_BS: {data: [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]}\nresolution: [64, 48]\n"
EUROC += "intrinsics: [60.0, 60.0, 32.0, 24.0]\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 1e-5]\n"
POSES = "".join(TUM.splitlines(keepends=True)[:5])
FLIGHT = {
    "cam0.yaml": EUROC,
    "imu.yaml": EUROC,
    "imu.csv": "".join(f"{NS + 10_000_000 * i},0.01,0,0,0,0,9.8\n" for i in range(30)),
    "truth.txt": "".join(f"{NS + 50_000_000 * i} {i / 20} 0 0 0 0 0 1\n" for i in range(6)),
}
DRIVES: dict[str, tuple[str, dict[str, str]]] = {
    "kitti": ("image", {"poses.txt": KITTI, "times.txt": "".join(f"{i / 10}\n" for i in range(5))}),
    "tum": ("rgb", {"poses.tum": POSES}),
    "c2w": ("image", {"poses.txt": C2W, "K.txt": "60 0 32\n0 60 24\n0 0 1\n"}),
    "drive": ("images", {"poses.tum": POSES, "wheel.csv": WHEEL, "imu.csv": IMU}),
    "locobot": ("rgb", {"odometry.csv": "".join(WHEEL.splitlines(keepends=True)[:6])}),
    "yolo": ("images", {f"labels/{i}.txt": LABELS for i in range(5)}),
    "euroc": ("image", FLIGHT),
}
PICTURE = cv2.imencode(".png", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def use_drive(spec: str) -> None:
    drive = open_drive(spec)
    assert len(drive.stamps_s) == len(drive.images)
    assert np.all(np.diff(drive.stamps_s) > 0.0)
    assert drive.rate_hz is None or (math.isfinite(drive.rate_hz) and drive.rate_hz > 0.0)
    if drive.truth is not None:
        use_trajectory(drive.truth)
    drained(drive_camera(drive, "test"))


@pytest.mark.parametrize("kind", DRIVES)
@MUTATED
@given(data=st.data())
def test_a_folder_with_damaged_files_is_read_or_refused_in_one_line(kind, data, tmp_path):
    place, texts = DRIVES[kind]
    files = {name: text.encode() for name, text in texts.items()} | {"camera.yaml": json.dumps(CAMERA).encode()}
    files["objects.json"] = json.dumps({"objects": [TRUTH]}).encode()
    files |= {f"{place}/{NS + 50_000_000 * i if kind == 'euroc' else i}.png": PICTURE for i in range(5)}
    for name in data.draw(st.lists(st.sampled_from([*files]), max_size=2, unique=True)):
        content = files.pop(name)
        if data.draw(st.integers(0, 4)):
            table = name.endswith((".txt", ".tum", ".csv"))
            files[name] = data.draw(mutated_rows(content.decode()) if table else mutated_bytes(content))
        elif data.draw(st.booleans()):
            files[data.draw(st.sampled_from(("x.png", "9" * 19 + ".png", "a\x1bb.png", "²")))] = content
    folder = tmp_path / kind
    shutil.rmtree(folder, ignore_errors=True)
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(content)
    refused_or(use_drive, f"{kind}:{folder}")


@pytest.mark.parametrize(
    ("name", "read", "begin", "times"),
    [
        ("map.json", load_annotated_map, b'{"format":"edgemap.map/1","frame":"map","objects":[[],', 9_000_000),
        ("line.tum", read_tum_3d, b"1 ", 10_000),
        ("lines.tum", read_tum_3d, b"1\n", 4_100_000),
        ("calibration.json", read_foreign_lens, b'{"cameras":[[],', 5_000_000),
    ],
)
def test_a_file_of_too_many_values_is_refused_before_they_are_made(name, read, begin, times, tmp_path):
    data = begin + begin[-3:] * times
    (tmp_path / name).write_bytes(data)
    tracemalloc.start()
    with pytest.raises(EdgemapError, match="at most"):
        read(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 5 * len(data) + 1_000_000
    tracemalloc.stop()


def test_sightings_of_a_run(tmp_path):
    good = {"label": "chair", "object": "chair-9", "map_m": [1.0, 2.0]}
    (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + '{"label": "torn')
    (tmp_path / "run.json").write_text('{"merged": ' + "[" * 100_000)
    assert [record.object for record in read_sightings(tmp_path)] == ["chair-9"]
    (tmp_path / "run.json").write_text('{"merged": {"chair-9": "chair-1"}}')
    assert [record.object for record in read_sightings(tmp_path)] == ["chair-1"]
    for line in ("[" * 100_000, "{}", json.dumps(good | {"map_m": [1.0]}), json.dumps(good | {"label": None}), "\0"):
        (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + line + "\n")
        assert "sightings.jsonl:2: damaged line" in refused(MapError, read_sightings, tmp_path)


def test_messages_stay_one_line_and_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none", Path("a\0b")):
        assert "cannot be read" in refused(MapError, read_bytes, path, MapError, 100)
    (tmp_path / "large").write_bytes(bytes(101))
    assert "101 bytes, at most 100" in refused(MapError, read_bytes, tmp_path / "large", MapError, 100)
    assert one_line("a\r\nb\x1b[31m\u2028c\udc80") == "a b [31m c"
    assert len(one_line("x" * 10_000)) == 200
    Image.new("1", (20_000, 20_000)).save(tmp_path / "a.png")
    assert "picture of more than 67,108,864 px" in refused(CameraError, read_picture, tmp_path / "a.png")
    assert stated_focal_px(tmp_path / "a.png", 640, 480) is None


def test_a_picture_whose_name_a_terminal_would_act_on_is_refused(tmp_path):
    for name in ("a\x1b[2J.png", "a\nb.png", os.fsdecode(b"\xff.png")):
        folder = tmp_path / f"{len(name)}{ord(name[0])}"
        folder.mkdir()
        (folder / name).write_bytes(b"")
        with pytest.raises(CameraError, match="characters that do not print") as caught:
            list_pictures(folder)
        assert str(caught.value).isprintable()


def test_a_small_grid_of_many_bytes_takes_no_memory_for_them():
    head, data = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "|i1", "fortran_order": False, "shape": (8192, 8191)})
    rest: Any = {"origin_m": np.array([-0.5, 1.0]), "resolution_m": np.array(0.05), "thresholds": np.array([-1.1, 0.6])}
    np.savez_compressed(data, **rest)
    with zipfile.ZipFile(data, "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("log_odds.npy", head.getvalue() + bytes(400 << 20))
    tracemalloc.start()
    with pytest.raises(MapError, match="at most"):
        read_grid(data.getvalue(), "bomb")
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["../grid.npz", "/etc/passwd", "a/grid.npz", "..", "a\\b.npz", ""])
def test_a_name_that_leaves_the_folder_is_refused(tmp_path, name):
    text = json.dumps({"format": "edgemap.map/1", "objects": [], "grid": name})
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(MapError):
        load_grid(tmp_path)
