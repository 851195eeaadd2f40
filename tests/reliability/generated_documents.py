"""Second fuzzer: JSON, YAML, tables, whole drive folders and the command line's texts, drawn from their grammars.

What a reader accepts is used the way the commands use it: a map is exported, queried and aligned with itself, a drive is
driven through. An AssertionError here says that something was accepted which cannot be.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.fault import CameraFault
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.frames.trajectory import TUM, read_tum
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.cameras.protocol import Camera
from edgemap.runtime.inputs.drives import camera_yaml, euroc, open_drive, pose_files, truth_json, yolo
from edgemap.runtime.inputs.drives.sensor_csv import IMU, WHEEL, read_imu_csv, read_wheel_csv
from edgemap.runtime.inputs.drives.yolo import COCO_NAMES
from edgemap.runtime.inputs.recordings import facts
from edgemap.runtime.network import manifest
from edgemap.runtime.outputs import sightings_file
from edgemap.runtime.step import edits, map_file
from edgemap.runtime.step.config import Config, config_document, load_config, load_efforts
from reliability import drawing as d
from reliability.drawing import ValueSource
from reliability.workers import ReaderCase

PIXELS = cv2.imencode(".png", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()
OTHER_PIXELS = cv2.imencode(".ppm", np.full((24, 32, 3), 90, np.uint8))[1].tobytes()


def cases(scratch: Path) -> list[ReaderCase]:
    """Every text format and text option. scratch: unused here."""
    del scratch
    return [
        ReaderCase("map.json, used", _map, _use_map),
        ReaderCase("objects.json", _json(truth_json._Objects, _mend_ids), _file("objects.json", truth_json.read_objects)),
        ReaderCase("boxes.json", _json(truth_json._Boxes, _mend_boxes), _file("boxes.json", truth_json.read_boxes)),
        ReaderCase("sightings.jsonl and run.json", _sightings, _read_sightings),
        ReaderCase("edits.jsonl", _edits, _file("edits.jsonl", edits.load_edits)),
        ReaderCase("bundle.json", _json(manifest.Manifest, _mend_manifest), _file("bundle.json", lambda path: manifest.read_manifest(path.parent))),
        ReaderCase("recording's facts", _facts, lambda _, record: facts.read_facts(record, "a.mcap")),
        ReaderCase("trajectory attachment", _attachment, lambda _, data: facts.read_trajectory_file(data, "a.mcap")),
        ReaderCase("config, JSON", _config_json, _file("run.json", _use_config)),
        ReaderCase("config, YAML", _config_yaml, _file("config.yaml", _use_config)),
        ReaderCase("camera.yaml", _yaml(camera_yaml._CameraYaml, _mend_camera), _file("camera.yaml", camera_yaml.read_camera_yaml)),
        ReaderCase("sensor.yaml, EuRoC", _yaml(euroc._Camera), _file("cam0.yaml", _read_sensor)),
        ReaderCase("wheel.csv", _table(WHEEL, _rolling), _file("wheel.csv", read_wheel_csv)),
        ReaderCase("imu.csv", _table(IMU, d.rising), _file("imu.csv", read_imu_csv)),
        ReaderCase("TUM, planar", _table(TUM, _posed), _file("a.tum", _use_tum)),
        ReaderCase("TUM, 3-D", _table(TUM, _posed), _file("a.tum", pose_files.read_tum_3d)),
        ReaderCase("poses.txt, KITTI", _table(pose_files.MATRICES[12], _rigid), _file("poses.txt", lambda path: _finite(pose_files.read_matrices(path, 12)))),
        ReaderCase("poses.txt, c2w", _table(pose_files.MATRICES[16], _rigid), _file("poses.txt", lambda path: _finite(pose_files.read_matrices(path, 16)))),
        ReaderCase("times.txt", _table(pose_files.STAMPS, d.rising), _file("times.txt", pose_files.read_stamps)),
        ReaderCase("yolo labels", _table(yolo.label_table(COCO_NAMES), _whole_classes), _read_labels),
        ReaderCase("folders of drives", _drive, _use_drive),
        ReaderCase("option texts", _option, _use_option),
    ]  # fmt: skip


def _file(name: str, read: Callable[[Path], Any]) -> Callable[[Path, bytes], Any]:
    def written(folder: Path, data: bytes) -> Any:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return written


def _json(kind: Any, mend: Callable[[ValueSource, Any], None] | None = None) -> Callable[[Random], bytes]:
    return lambda random: d.json_bytes(ValueSource(random), kind, mend)


def _yaml(kind: Any, mend: Callable[[ValueSource, Any], None] | None = None) -> Callable[[Random], bytes]:
    def make(random: Random) -> bytes:
        draw = ValueSource(random)
        tree = d.of_type(draw, kind)
        if mend is not None and isinstance(tree, dict):
            mend(draw, tree)
        return d.encoded(
            draw, draw.pick(("", "", "%YAML:1.0\n", "---\n", "%YAML 1.2\n---\n")) + d.yaml_text(draw, tree)
        )

    return make


def _table(table: Any, mend: Callable[[ValueSource, list[list[float]]], None]) -> Callable[[Random], bytes]:
    return lambda random: d.table_bytes(ValueSource(random), table, mend=mend)


def _finite(value: Any) -> Any:
    assert np.all(np.isfinite(value))
    return value


# Maps.


def _map(random: Random) -> bytes:
    draw = ValueSource(random)
    tree = d.of_type(draw, map_file._Map)
    if isinstance(tree, dict):
        _mend_ids(draw, tree)
        tree = {"format": map_file.FORMAT if not draw.hurt() else draw.text(), **tree}
        for record in (*_items(tree, "objects"), *_items(tree, "deleted")):
            if isinstance(record, dict):
                _mend_object(draw, record)
    return d.encoded(draw, d.json_text(draw, tree))


def _items(tree: dict[str, Any], name: str) -> list[Any]:
    found = tree.get(name)
    return found if isinstance(found, list) else []


def _mend_object(draw: ValueSource, record: dict[str, Any]) -> None:
    if isinstance(first := record.get("first_seen_s"), float | int) and not draw.hurt():
        record["last_seen_s"] = min(first + draw.pick((0.0, 1.0, 1e6)), 1e12)
    if not draw.hurt():
        a, b, turn = abs(draw.real(0.0, 1e5)), abs(draw.real(0.0, 1e5)), draw.pick((0.0, 0.5, 2.0))
        cos, sin = math.cos(turn), math.sin(turn)
        xy = (a - b) * sin * cos
        record["covariance_m2"] = [[a * cos * cos + b * sin * sin, xy], [xy, a * sin * sin + b * cos * cos]]


def _mend_ids(draw: ValueSource, tree: dict[str, Any]) -> None:
    """Ids that are unlike, as most files have them."""
    for number, record in enumerate((*_items(tree, "objects"), *_items(tree, "deleted"), *_items(tree, "zones"))):
        if isinstance(record, dict) and not draw.hurt():
            record["id"] = f"{draw.pick(d.NAMES)}-{number}" if draw.chance(0.9) else draw.text() + str(number)


def _use_map(folder: Path, data: bytes) -> None:
    from edgemap.geometry.objects import queries
    from edgemap.geometry.objects.merge import merge_maps
    from edgemap.geometry.registration.alignment import align
    from edgemap.runtime.outputs.mapfiles.geojson import geojson_text
    from edgemap.runtime.outputs.mapfiles.grid import grid_of
    from edgemap.runtime.outputs.mapfiles.nav2 import vector_text
    from edgemap.runtime.outputs.mapfiles.table import csv_text

    path = folder / "map.json"
    path.write_bytes(data)
    objects, annotations = map_file.load_annotated_map(path)
    for item in (*objects, *annotations.deleted):
        assert np.all(np.isfinite(item.position_m))
        assert np.all(np.linalg.eigvalsh(item.covariance_m2) > 0.0)
        assert item.last_seen_s >= item.first_seen_s
    assert len({item.id for item in objects}) == len(objects)
    map_file.save_map(folder / "again.json", objects, annotations)
    again, said = map_file.load_annotated_map(folder / "again.json")
    assert [zone.id for zone in said.zones] == [zone.id for zone in annotations.zones]
    assert [item.id for item in again] == [item.id for item in objects]
    if objects:
        queries.nearest(objects, (0.0, 0.0))
    queries.inside_polygon(objects, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for text in (geojson_text(objects), csv_text(objects)):
        text.encode()
    for export in (vector_text, grid_of, lambda found: merge_maps(found, again, align(found, again))):
        with suppress(EdgemapError):  # a map may be too large for a grid, and too small to be aligned with another
            export(objects)


def _sightings(random: Random) -> bytes:
    draw = ValueSource(random)
    lines = [d.json_text(draw, d.of_type(draw, sightings_file.SeenRecord)) for _ in range(draw.count(9))]
    return (
        d.encoded(draw, "\n".join(lines) + draw.pick(("\n", "\n", "", "\n\n", "\r\n")))
        + b"\0split"
        + d.json_bytes(draw, sightings_file._Run)
    )


def _edits(random: Random) -> bytes:
    draw = ValueSource(random)
    lines = []
    for _ in range(draw.count(5)):
        tree = d.of_type(draw, edits._Line)
        if isinstance(tree, dict) and not draw.hurt():
            tree["do"] = draw.pick(edits.KINDS)
        lines.append(d.json_text(draw, tree))
    return d.encoded(draw, "\n".join(lines) + draw.pick(("\n", "")))


def _read_sightings(folder: Path, data: bytes) -> Any:
    lines, _, run = data.partition(b"\0split")
    (folder / "sightings.jsonl").write_bytes(lines)
    (folder / "run.json").write_bytes(run)
    return sightings_file.read_sightings(folder)


# Boxes, bundles, recordings' parts.


def _mend_boxes(draw: ValueSource, tree: dict[str, Any]) -> None:
    for frame in tree.get("frames") or [] if isinstance(tree.get("frames"), list) else []:
        for box in frame if isinstance(frame, list) else []:
            if isinstance(box, dict) and isinstance(corners := box.get("box"), list) and not draw.hurt():
                with_numbers = [value for value in corners if isinstance(value, float | int)]
                if len(with_numbers) == 4 == len(corners):
                    x, y = sorted(corners[0::2]), sorted(corners[1::2])
                    box["box"] = [x[0], y[0], x[1], y[1]]


def _mend_manifest(draw: ValueSource, tree: dict[str, Any]) -> None:
    if not draw.hurt():
        tree["format"] = manifest.FORMAT
    detector = tree.get("detector")
    if not isinstance(detector, dict):
        return
    files = ["backbone.onnx", "a/b.onnx", "head.onnx"]
    for part in (detector, *_values(tree.get("odometry")), *_values(tree.get("variants"))):
        if isinstance(part, dict) and not draw.hurt():
            part["file"] = (
                draw.pick(files)
                if not draw.hurt()
                else draw.pick(("/x", "../x", "bundle.json", "a/../../x", "", ".", "a\\b", "x\0y"))
            )
    if not draw.hurt():
        tree["sha256"] = dict.fromkeys(files, "0123456789abcdef" * 4)
    spec, classes = detector.get("input"), detector.get("classes")
    if draw.hurt() or not isinstance(spec, dict) or not isinstance(classes, list):
        return
    width, height = draw.pick((64, 416, 4096)), draw.pick((64, 416, 4096))
    spec |= {"width": width, "height": height}
    values, rule = 5 + len(classes), draw.pick(("yolov3", "yolox", "dfl"))
    stride, anchors = draw.pick((8, 32, 64)), [[10.0, 20.0]] * draw.random.randrange(4)
    shape = {
        "yolov3": [1, max(len(anchors), 1) * values, height // stride, width // stride],
        "yolox": [1, (height // stride) * (width // stride), values],
        "dfl": [1, values + manifest.DFL_CHANNELS - 5, -(-height // stride), -(-width // stride)],
    }[rule]
    detector |= {"decode": rule, "heads": [{"name": "out", "shape": shape, "strides": [stride], "anchors": anchors}]}


def _values(tree: Any) -> list[Any]:
    return list(tree.values()) if isinstance(tree, dict) else []


def _facts(random: Random) -> dict[str, str]:
    draw = ValueSource(random)
    record = {
        "format": facts.FORMAT, "camera": draw.text(), "rate_hz": d.json_text(draw, d.of_type(draw, facts._RATE)),
        "intrinsics": d.json_text(draw, d.of_type(draw, facts._LENS)), "mount": d.json_text(draw, d.of_type(draw, facts._MOUNT)),
    }  # fmt: skip
    if draw.hurt():
        record[draw.pick(list(record))] = draw.text()
    if draw.chance(0.3):
        record["decisions"] = d.json_text(draw, d.of_type(draw, facts._DECISIONS))
    if draw.hurt():
        del record[draw.pick(list(record))]
    return record


def _attachment(random: Random) -> bytes:
    draw = ValueSource(random)
    rows = [[draw.real(column.minimum, column.maximum) for column in WHEEL.columns] for _ in range(draw.count(9))]
    d.rising(draw, rows)
    tree: list[Any] = [
        row if not draw.hurt() else draw.pick((row[:3], [*row, 0], [], {}, [[]] * 4, None)) for row in rows
    ]
    return d.encoded(draw, d.json_text(draw, tree))


# Configuration.


def _config_tree(draw: ValueSource) -> dict[str, Any]:
    document: dict[str, Any] = {}
    whole = config_document(Config())
    if not draw.hurt():
        document["config"] = _some(draw, whole)
    if draw.chance(0.5):
        flags = (
            "camera",
            "bundle",
            "mount",
            "frames",
            "view",
            "loop_closure",
            "classes",
            "out",
            "x y",
            "",
            "--a",
            "a=b",
        )
        document["options"] = {
            draw.pick(flags): draw.pick((True, False, None, 1, 0.5, draw.text(), ["a"], {"b": [1]}, 10**18))
            for _ in range(draw.count(5))
        }
    if draw.chance(0.2):
        document["efforts"] = [
            {"since": draw.whole(0, 99), "search_every": 2, "take_every": draw.pick((1, 1, 0, -1, 1001))}
        ]
    if draw.hurt():
        document[draw.pick(("config", "options", "efforts", "x"))] = draw.pick(
            (None, [], 1, "x", [[]], d.Raw("[" * 900 + "]" * 900))
        )
    return document


def _some(draw: ValueSource, tree: Any) -> Any:
    """Part of the tree with other values."""
    if isinstance(tree, dict):
        found = {name: _some(draw, item) for name, item in tree.items() if draw.chance(0.4)}
        if draw.hurt():
            found[draw.text()] = draw.pick((1, "x", {}, []))
        return found if not draw.hurt() else draw.pick((None, [found], 3, "x", d.Raw("[" * 700 + "]" * 700)))
    if draw.hurt():
        return draw.pick((None, "1", [tree], {"a": tree}, True, d.Raw(draw.pick(d.ODD_NUMBERS)), "b" * 5000))
    if isinstance(tree, bool):
        return draw.chance(0.5)
    return draw.whole(0, 1 << 40) if isinstance(tree, int) else draw.real(-1e11, 1e11)


def _config_json(random: Random) -> bytes:
    draw = ValueSource(random)
    return d.encoded(draw, d.json_text(draw, _config_tree(draw)))


def _config_yaml(random: Random) -> bytes:
    draw = ValueSource(random)
    return d.encoded(draw, d.yaml_text(draw, _config_tree(draw)))


def _use_config(path: Path) -> None:
    tuned, _ = load_config(path)
    config_document(tuned)
    load_efforts(path)


def _mend_camera(draw: ValueSource, tree: dict[str, Any]) -> None:
    if draw.hurt():
        return
    width, height = draw.pick((64, 640, 65536)), draw.pick((48, 480, 65536))
    tree |= {"width": width, "height": height, "cx": width / 2, "cy": height / 2}
    if isinstance(tree.get("distortion"), dict):
        tree["distortion"]["model"] = draw.pick(("none", "brown_conrady", "inverse_brown_conrady"))


def _read_sensor(path: Path) -> None:
    camera = euroc._sensor(path, euroc._Camera)
    _finite(camera.T_BS.rotation)
    euroc._lens(path, camera)


# Tables.


def _rolling(draw: ValueSource, rows: list[list[float]]) -> None:
    d.rising(draw, rows)
    x_m = 0.0
    for row in rows:
        x_m += draw.pick((0.0, 0.05, 0.1)) if not draw.hurt() else draw.pick((1e3, 11.0, -1e6))
        row[1:] = [x_m, draw.random.gauss(0.0, 0.1), draw.real(-1e6, 1e6) if draw.chance(0.1) else draw.real(-3.2, 3.2)]


def _posed(draw: ValueSource, rows: list[list[float]]) -> None:
    d.rising(draw, rows)
    d.unit(draw, rows, 4)


def _rigid(draw: ValueSource, rows: list[list[float]]) -> None:
    for row in rows:
        turn = [[0.0] * 4]
        d.unit(draw, turn, 0)
        pose = pose_files.poses_of(np.array([row[3:12:4]]), np.array(turn))[0]
        flat = pose.ravel().tolist()[: len(row)]
        row[:] = flat if not draw.hurt() else [value * draw.pick((1.0, -1.0, 1.04, 1e5)) for value in flat]


def _whole_classes(draw: ValueSource, rows: list[list[float]]) -> None:
    for row in rows:
        row[0] = float(round(row[0])) if not draw.hurt() else row[0] + 0.5


def _use_tum(path: Path) -> None:
    way = read_tum(path)
    _finite([pose.vector() for pose in way.from_start().poses])
    way.at(float(way.stamps_s[0]))


def _read_labels(folder: Path, data: bytes) -> Any:
    (folder / "a.png").write_bytes(PIXELS)
    (folder / "a.txt").write_bytes(data)
    return _finite(yolo._read_labels(folder / "a.txt", folder / "a.png", COCO_NAMES).boxes)


# Folders: every layout, with files that fit each other or not.


def _drive(random: Random) -> tuple[str, dict[str, bytes]]:
    draw = ValueSource(random, damage=random.choice((0.0, 0.0, 0.003, 0.01, 0.05)))
    kind, count = draw.pick(("kitti", "tum", "c2w", "drive", "euroc", "locobot", "yolo")), draw.pick((1, 2, 3, 5))
    lines = count if not draw.hurt() else draw.count(5)
    camera = _lens_yaml(draw)
    files: dict[str, bytes] = {} if draw.chance(0.3) and kind != "drive" else {"camera.yaml": camera}
    numbers = [str(number) for number in range(count)]
    if kind == "euroc":
        numbers = [str(1_400_000_000_000_000_000 + 50_000_000 * number) for number in range(count)]
    place = {
        "kitti": "image",
        "tum": "rgb",
        "c2w": "image",
        "drive": "images",
        "euroc": "image",
        "locobot": "rgb",
        "yolo": "images",
    }[kind]
    for name in numbers:
        picture = PIXELS if not draw.hurt() else draw.pick((OTHER_PIXELS, PIXELS[:50], b""))
        name = name if not draw.hurt() else draw.pick(("x", "9" * 19, "00", "a\x1bb", "é", "²"))
        files[f"{place}/{name}{draw.pick(('.png', '.png', '.PNG')) if not draw.hurt() else '.txt'}"] = picture
    table = lambda columns, mend: d.table_bytes(draw, columns, lines, mend)  # noqa: E731
    if kind == "kitti":
        files["poses.txt"] = table(pose_files.MATRICES[12], _rigid)
        if draw.chance(0.5):
            files["times.txt"] = table(pose_files.STAMPS, d.rising)
    elif kind == "tum" and draw.chance(0.5):
        files["poses.tum"] = table(TUM, _level)
    elif kind == "tum":
        listed = [
            f"{0.1 * row + 1:.6f} rgb/{name}.png" if not draw.hurt() else draw.text()
            for row, name in enumerate(numbers)
        ]
        files["rgb.txt"] = d.encoded(draw, "# listing\n" + "\n".join(listed))
        files["groundtruth.txt"] = d.table_bytes(draw, TUM, 20, _level)
    elif kind == "c2w":
        files["poses.txt"] = table(pose_files.MATRICES[16], _rigid)
        if draw.chance(0.5):
            files["K.txt"] = d.encoded(
                draw,
                " ".join(
                    draw.pick(d.ODD_NUMBERS) if draw.hurt() else word
                    for word in ("60", "0", "32", "0", "60", "24", "0", "0", "1")
                ),
            )
    elif kind == "drive":
        files["poses.tum"] = table(TUM, _level)
        if draw.chance(0.3):
            files["stamps.txt"] = table(pose_files.STAMPS, d.rising)
        if draw.chance(0.5):
            files["wheel.csv"], files["imu.csv"] = (
                d.table_bytes(draw, WHEEL, mend=_rolling),
                d.table_bytes(draw, IMU, mend=d.rising),
            )
        if draw.chance(0.3):
            frames = [d.of_type(draw, list[truth_json._Box]) for _ in range(lines)]
            tree = {"frames": frames}
            _mend_boxes(draw, tree)
            files["boxes.json"] = d.encoded(draw, d.json_text(draw, tree))
    elif kind == "locobot":
        files["odometry.csv"] = table(WHEEL, _rolling)
        if draw.chance(0.4):
            files["poses.tum"] = table(TUM, _level)
    elif kind == "yolo":
        for name in numbers:
            files[f"labels/{name}.txt"] = d.table_bytes(draw, yolo.label_table(COCO_NAMES), mend=_whole_classes)
    else:
        files["imu.csv"] = d.table_bytes(draw, euroc.SAMPLES, 5, _in_ns)
        files["truth.txt"] = d.table_bytes(draw, euroc.CAMERA, 9, _posed_in_ns)
        files["cam0.yaml"] = _sensor_yaml(draw)
        if draw.chance(0.5):
            files["imu.yaml"] = _sensor_yaml(draw)
    if draw.chance(0.3):
        files["objects.json"] = d.json_bytes(draw, truth_json._Objects, _mend_ids)
    for name in list(files):
        if draw.hurt() and draw.chance(0.3):
            del files[name]
    return kind, files


def _lens_yaml(draw: ValueSource) -> bytes:
    tree = {
        "width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 32.0, "cy": 24.0,
        "fps": draw.pick((10.0, 30.0, 1e-300, 1e5)), "world_up": draw.pick(("x", "y", "z", "-x", "-y", "-z", "z", "z")),
        "mount": {"height_m": draw.pick((0.6, 1.2)), "pitch_deg": draw.pick((11.5, 0.0, 89.0, -30.0)), "forward_m": 0.1},
    }  # fmt: skip
    if draw.hurt():
        tree[draw.pick(list(tree))] = draw.pick((0, -1, "x", None, [], 1e300))
    return d.encoded(draw, d.yaml_text(draw, tree))


def _sensor_yaml(draw: ValueSource) -> bytes:
    turn = [[0.0] * 4]
    d.unit(draw, turn, 0)
    pose = pose_files.poses_of(np.zeros((1, 3)), np.array(turn))[0].ravel().tolist()
    tree = {
        "T_BS": {"cols": 4, "rows": 4, "data": pose}, "resolution": [64, 48], "intrinsics": [60.0, 60.0, 32.0, 24.0],
        "distortion_coefficients": [-0.28, 0.07, 0.0002, 1e-5], "comment": draw.text(),
    }  # fmt: skip
    if draw.hurt():
        tree[draw.pick(list(tree))] = draw.pick((0, -1, "x", None, [], [1e300] * 4, {"data": [0.0] * 16}))
    return d.encoded(draw, "%YAML:1.0\n" + d.yaml_text(draw, tree))


def _posed_in_ns(draw: ValueSource, rows: list[list[float]]) -> None:
    _in_ns(draw, rows)
    d.unit(draw, rows, 4)


def _level(draw: ValueSource, rows: list[list[float]]) -> None:
    _posed(draw, rows)
    if draw.chance(0.7):
        for row in rows:
            yaw = draw.real(-3.1, 3.1)
            row[1:] = [draw.real(-5.0, 5.0), draw.real(-5.0, 5.0), 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]


def _in_ns(draw: ValueSource, rows: list[list[float]]) -> None:
    for number, row in enumerate(rows):
        row[0] = 1_400_000_000_000_000_000 + 50_000_000.0 * number if not draw.hurt() else draw.real(0.0, 1e19)


def _use_drive(folder: Path, drawn: tuple[str, dict[str, bytes]]) -> None:
    kind, files = drawn
    place = folder / "drive"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for name, data in files.items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_bytes(data)
    drive = open_drive(f"{kind}:{place}")
    assert len(drive.stamps_s) == len(drive.images)
    assert all(b > a for a, b in pairwise(drive.stamps_s))
    assert drive.rate_hz is None or (math.isfinite(drive.rate_hz) and drive.rate_hz > 0.0)
    if drive.truth is not None:
        _finite([pose.vector() for pose in drive.truth.poses])
    if drive.full_poses is not None:
        _finite(drive.full_poses)
    for boxes in drive.boxes:
        boxes.seen_ids()
    if drive.attitudes is not None and drive.mount is not None:
        drive.attitudes.at(float(drive.stamps_s[0]), drive.mount.height_m)
    with drive_camera(drive, "fuzz") as camera:
        _drain(camera)


def _drain(camera: Camera) -> None:
    """All frames; faults are what a run goes on past."""
    last_s = -math.inf
    for _ in range(50):
        try:
            frame = camera.read()
        except CameraFault:
            continue
        if frame is None:
            return
        assert frame.image.dtype == np.uint8
        assert frame.stamp_s >= last_s
        last_s = frame.stamp_s


# What is typed.

OPTIONS = (
    "--mount",
    "--intrinsics",
    "--start",
    "--near",
    "--inside",
    "--classes",
    "--board",
    "camera",
    "data",
    "bundle",
    "wheel",
    "sim",
    "url",
    "--mqtt",
)
SPEC_PARTS = (
    "demo", "realsense:/x.bag", "kitti:", "tum:", "c2w:", "drive:", "euroc:", "locobot:", "yolo:", "sim:",
    ".", "..", "/", "/dev/null", "/dev/zero", "/dev/video", "/dev/stdin", "/proc/self/mem", "/proc/self/environ", "~", "~root", "~nobody-here",
    ".mcap", "a.mcap", "#/topic", "#", ":", "//", "0", "9", "99", "١", "²", "%d", "%03d.png", "a" * 300, "a" * 5000, "\udcff", "\n",
    "\x1b[2J", "\0", " ", "-", "--", "concat:", "file:", "pipe:0", ".mp4", ".bag", "?x=1", "é", "[", "]", "@", "x",
)  # fmt: skip


def _option(random: Random) -> tuple[str, str]:
    draw = ValueSource(random, damage=random.choice((0.0, 0.1, 0.5)))
    option = draw.pick(OPTIONS)
    if option in ("camera", "data", "bundle", "wheel"):
        return option, "".join(draw.pick(SPEC_PARTS) for _ in range(draw.pick((1, 1, 2, 2, 3, 5))))
    if option == "--mqtt":
        port = (
            draw.pick(("", ":1883", ":0"))
            if not draw.hurt()
            else ":" + draw.pick((*d.ODD_NUMBERS, "65536", "²", "٣", ""))
        )
        return option, draw.pick(("localhost", "[::1]", "::1", "[::1", "]", "", "a b")) + port
    if option in ("sim", "url"):
        start = (
            "sim:" if option == "sim" else draw.pick(("http://", "https://", "HTTP://", "http:/", "ftp://", "file://"))
        )
        return option, start + draw.pick((draw.text(), str(draw.whole(-9, 1 << 70)), draw.pick(SPEC_PARTS)))
    counts = {"--mount": 2, "--intrinsics": 4, "--start": 3, "--near": 2, "--inside": 2, "--board": 2, "--classes": 2}
    count = counts[option] if not draw.hurt() else draw.count(9)
    words = [
        draw.pick((*d.ODD_NUMBERS, *d.ODD_TEXTS)) if draw.hurt() else f"{draw.real(-100.0, 1000.0):g}"
        for _ in range(count)
    ]
    if option == "--inside":
        words = [";".join(",".join(words) for _ in range(draw.pick((1, 3, 4))))]
    if option == "--board":
        return option, draw.pick(("x", "X", "*", "")).join(words)
    return option, ",".join(words)


def _use_option(folder: Path, drawn: tuple[str, str]) -> None:
    del folder
    option, text = drawn
    try:
        _use_text(option, text)
    except (OSError, EdgemapError) as error:  # the command line prints both so
        raise EdgemapError(printable(str(error))) from None


def _use_text(option: str, text: str) -> None:
    # By name: no room imports the command line.
    options = import_module("edgemap.cli.options")
    read_board = import_module("edgemap.cli.calibrate_options").read_board
    question = import_module("edgemap.cli.map_show")._Question
    from edgemap.runtime.inputs.cameras.webcam import StreamDriver
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.motion.odometry import wheel_trajectory
    from edgemap.runtime.network.download import is_url
    from edgemap.runtime.network.store import bundle_folder

    match option:
        case "--mount":
            mount = options.read_mount(text)
            assert mount is not None
            _finite(mount.rotation_base_optical())
        case "--intrinsics":
            lens = options.read_intrinsics(text, 640, 480)
            assert lens is not None
        case "--start":
            _finite(options.numbers(text, "--start", "X,Y,YAW_DEG"))
        case "--near":
            question.read(None, text, None, None).answer([])
        case "--inside":
            question.read(None, None, text, None).answer([])
        case "--classes":
            question.read(text, None, None, None).answer([])
        case "--board":
            read_board(text)
        case "--mqtt":
            import_module("edgemap.cli.publishers").host_and_port(text, "--mqtt", 1883)
        case "url":
            is_url(text)
            StreamDriver(text)
        case "bundle":
            bundle_folder(text)
        case "data":
            open_drive(text)
        case "wheel":
            wheel_trajectory(text)
        case _:
            open_camera(text).close()
