"""The readers under test: for each, valid documents, how they are mutated, and the call that reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np

from reliability.mutations import json_bytes, mutated_bytes, mutated_rows, mutated_tree
from reliability.workers import ReaderCase

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
    "width": 640, "height": 480, "fx": 587.0, "fy": 587.5, "cx": 319.5, "cy": 239.5, "fps": 10.0, "world_up": "z",
    "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0.001, 0.0, 0.02]},
    "mount": {"height_m": 0.6, "pitch_deg": 11.5, "roll_deg": 0.5, "forward_m": 0.15, "left_m": 0.0},
    "calibration": {"intrinsics": {"pictures": 20, "rms_px": 0.2}},
}  # fmt: skip
YAML_TEXTS = (
    "!!python/object:os.system ",
    "!!int ",
    "&a ",
    "*a ",
    "!!binary ",
    "<<: ",
    "? ",
    "2026-01-01",
    "- " * 50,
    "\t",
)
TUM = "".join(f"{i / 10} {i / 20} {i / 50} 0 0 0 {np.sin(i / 40):.9f} {np.cos(i / 40):.9f}\n" for i in range(12))
WHEEL = "stamp_s,x_m,y_m,yaw_rad\n" + "".join(f"{i / 10},{i / 20},{i / 50},{i / 30}\n" for i in range(12))
IMU = "stamp_s,gx,gy,gz,ax,ay,az\n" + "".join(f"{i / 200},0.01,-0.02,0.1,0.2,9.8,{i / 9}\n" for i in range(12))
CFG = """[net]
width=64
height=64
channels=3
[convolutional]
batch_normalize=1
filters=8
size=3
stride=2
pad=1
activation=leaky
[maxpool]
size=2
stride=2
[convolutional]
filters=16
size=3
stride=1
pad=1
groups=2
activation=mish
[route]
layers=-1,-2
[route]
layers=-2
[shortcut]
from=-3
activation=linear
[upsample]
stride=2
[avgpool]
[route]
layers=5
[convolutional]
filters=16
size=1
activation=linear
[yolo]
mask=0,1
anchors=10,14, 23,27, 37,58
classes=3
num=3
scale_x_y=1.05
"""


def _file(name: str, read: Callable[[Path], object]) -> Callable[[Path, Any], object]:
    def call(folder: Path, data: bytes) -> object:
        path = folder / name
        path.write_bytes(data)
        return read(path)

    return call


def _json(name: str, tree: Any, read: Callable[[Path], object], file: str) -> ReaderCase:
    return ReaderCase(name, lambda random: json_bytes(random, tree), _file(file, read))


def _rows(name: str, text: str, read: Callable[[Path], object], file: str) -> ReaderCase:
    return ReaderCase(name, lambda random: mutated_rows(random, text.encode()), _file(file, read))


def cases(scratch: Path) -> list[ReaderCase]:
    """Every reader. scratch: a folder for what valid documents are made from."""
    import torch

    torch.set_num_threads(1)  # threads do not survive the fork of a worker
    cv2.setNumThreads(0)
    return [*_tables_and_json(), _pictures(), *_models(scratch), *_recordings(), _camera_yaml()]


def _tables_and_json() -> list[ReaderCase]:
    from edgemap.export.darknet import Darknet
    from edgemap.runtime.frames.errors import CameraError
    from edgemap.runtime.frames.trajectory import read_tum
    from edgemap.runtime.inputs.drives.pose_files import read_matrices, read_stamps, read_tum_3d
    from edgemap.runtime.inputs.drives.sensor_csv import read_imu_csv, read_wheel_csv
    from edgemap.runtime.inputs.drives.truth_json import read_boxes, read_objects
    from edgemap.runtime.inputs.drives.yolo import COCO_NAMES, label_table
    from edgemap.runtime.inputs.recordings.facts import read_trajectory_file
    from edgemap.runtime.step.map_file import load_map

    rows, boxes = [[i / 10, i / 20, 0.1, 0.2] for i in range(5)], [377.0, 0.0, 470.0, 190.0]
    pose = "0 0 1 {} -1 0 0 0 0 -1 0 1"
    truth = {
        "id": 1,
        "label": "chair",
        "x_m": 1.0,
        "y_m": 2.0,
        "on_floor": True,
        "footprint_m": [[0.1, 0.2], [0.3, 0.4]],
    }
    truth |= {"width_m": 1.0, "depth_m": 0.5, "height_m": 0.8, "visible_frames": 50}
    box = {"id": 25, "label": "refrigerator", "box": boxes, "visible": 0.5}
    poses = "".join(pose.format(i) + "\n" for i in range(5))
    return [
        _json("map.json", MAP, load_map, "map.json"),
        _json("objects.json", {"objects": [truth, truth | {"id": 2}]}, read_objects, "objects.json"),
        _json("boxes.json", {"frames": [[box, box], [], [box]]}, read_boxes, "boxes.json"),
        _json(
            "trajectory attachment", rows, lambda path: read_trajectory_file(path.read_bytes(), "a.mcap"), "wheel.json"
        ),
        _rows("wheel.csv", WHEEL, read_wheel_csv, "wheel.csv"),
        _rows("imu.csv", IMU, read_imu_csv, "imu.csv"),
        _rows("TUM, planar", TUM, read_tum, "a.tum"),
        _rows("TUM, 3-D", TUM, read_tum_3d, "poses.tum"),
        _rows("poses.txt, KITTI", poses, lambda path: read_matrices(path, 12), "poses.txt"),
        _rows(
            "poses.txt, c2w", poses.replace("0 1\n", "0 1 0 0 0 1\n"), lambda path: read_matrices(path, 16), "poses.txt"
        ),
        _rows("times.txt", "0.0\n0.1\n0.2\n1e0\n", read_stamps, "times.txt"),
        _rows(
            "yolo labels",
            "56 0.5 0.5 0.25 0.5\n0 0.1 0.2 0.1 0.1\n",
            lambda p: label_table(COCO_NAMES).read(p, CameraError),
            "0.txt",
        ),
        _rows("Darknet cfg", CFG, Darknet.from_cfg, "a.cfg"),
    ]


def _camera_yaml() -> ReaderCase:
    import yaml

    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml

    def make(random: Random) -> bytes:
        if random.random() < 0.5:
            return json_bytes(random, CAMERA)  # JSON is YAML, nearly
        flow = random.choice((None, True, False))
        text = yaml.safe_dump(mutated_tree(random, CAMERA), default_flow_style=flow, allow_unicode=True)
        if random.random() < 0.4:
            at = random.choice([i for i, letter in enumerate(text) if letter in " \n"] or [0]) + 1
            text = text[:at] + random.choice(YAML_TEXTS) + text[at:]
        data = text.encode(errors="surrogatepass")
        return mutated_bytes(random, data) if random.random() < 0.1 else data

    return ReaderCase("camera.yaml", make, _file("camera.yaml", read_camera_yaml))


def _pictures() -> ReaderCase:
    from edgemap.runtime.inputs.drives.pictures import read_picture

    image = np.random.default_rng(0).integers(0, 255, (12, 17, 3), np.uint8)
    image[:, :8] = 100
    suffixes = (".png", ".jpg", ".bmp", ".ppm", ".pgm", ".tif", ".webp")
    valid = [cv2.imencode(suffix, image[:, :, 0] if suffix == ".pgm" else image)[1].tobytes() for suffix in suffixes]
    valid.append(cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_PROGRESSIVE, 1))[1].tobytes())

    def make(random: Random) -> bytes:
        data = random.choice(valid)
        if random.random() < 0.3:  # most of what a header says stands in the first bytes
            return mutated_bytes(random, data[:40]) + data[40:]
        return mutated_bytes(random, data)

    return ReaderCase("pictures", make, _file("a.png", read_picture))


def _recordings() -> list[ReaderCase]:
    from io import BytesIO

    from mcap.writer import CompressionType, IndexType
    from mcap.writer import Writer as McapWriter
    from mcap_ros2.writer import Writer

    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount
    from edgemap.geometry.se2 import SE2
    from edgemap.runtime.frames.messages.definitions import definition
    from edgemap.runtime.inputs.recordings.camera import RecordingCamera
    from edgemap.runtime.inputs.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, Facts, facts_record
    from edgemap.runtime.inputs.recordings.sensors import read_wheel
    from edgemap.runtime.outputs.messages import build as messages

    lens, mount = Intrinsics(17, 12, 20.0, 20.0, 8.0, 6.0), Mount.from_degrees(0.6, 10.0)
    picture = cv2.imencode(".png", np.full((12, 17, 3), 90, np.uint8))[1].tobytes()
    facts = {name: json.loads(text) if text[:1] in "{0123456789n" else text
             for name, text in facts_record(Facts("test", lens, mount, 10.0)).items()}  # fmt: skip
    compressions = (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD)

    def sent(stamp_ns: int) -> list[list[Any]]:
        raw = {"header": messages.header(stamp_ns, "camera"), "height": 12, "width": 17, "encoding": "bgr8", "step": 51}
        raw |= {"is_bigendian": 0, "data": bytes(612)}
        compressed = messages.compressed_image(stamp_ns, picture, "png")
        return [
            ["/tf", "tf2_msgs/msg/TFMessage", messages.tf(messages.mount_transform(stamp_ns, mount))],
            ["/camera/camera_info", "sensor_msgs/msg/CameraInfo", messages.camera_info(stamp_ns, lens)],
            ["/wheel/odometry", "nav_msgs/msg/Odometry", messages.odometry(stamp_ns, SE2(stamp_ns / 1e9, 0.1, 0.2))],
            ["/camera/image/compressed", "sensor_msgs/msg/CompressedImage", compressed],
            ["/camera/image_raw", "sensor_msgs/msg/Image", raw],
        ]

    def make(random: Random) -> bytes:
        stream, ours = BytesIO(), random.random() < 0.4
        writer = Writer(
            stream, random.choice((1, 2000, 1 << 20)), random.choice(compressions), enable_crcs=random.random() < 0.3
        )
        if random.random() < 0.3:  # without the index that edgemap reads by
            writer._writer = McapWriter(stream, use_chunking=random.random() < 0.5, index_types=IndexType.NONE)
            stream.seek(0)
            writer._writer.start("ros2", "edgemap")
        if ours:
            record = mutated_tree(random, facts) if random.random() < 0.5 else facts
            record = record if isinstance(record, dict) else {}
            texts = {str(key): value if isinstance(value, str) else json.dumps(value) for key, value in record.items()}
            writer.add_metadata(RECORD, texts)
            rows = [[i / 10, i / 20, 0.1, 0.2] for i in range(4)]
            for name in (WHEEL_FILE, TRUTH_FILE):
                data = json_bytes(random, rows) if random.random() < 0.3 else json.dumps(rows).encode()
                writer.add_attachment(0, 0, name, "application/json", data)
        schemas: dict[str, Any] = {}
        for number in range(random.choice((1, 3, 3))):
            stamp_ns = 10**9 + number * 10**8
            for topic, kind, message in sent(stamp_ns):
                if kind not in schemas:
                    schemas[kind] = writer.register_msgdef(kind, definition(kind))
                changed = mutated_tree(random, message) if random.random() < 0.1 else message
                try:
                    writer.write_message(topic, schemas[kind], changed, stamp_ns, stamp_ns)
                except Exception:  # the writer does not encode it
                    writer.write_message(topic, schemas[kind], message, stamp_ns, stamp_ns)
        writer.finish()
        return mutated_bytes(random, stream.getvalue()) if random.random() < 0.5 else stream.getvalue()

    def play(path: Path) -> None:
        with RecordingCamera(str(path)) as camera:
            while camera.read() is not None:
                pass

    return [
        ReaderCase("MCAP, camera", make, _file("a.mcap", play)),
        ReaderCase("MCAP, wheels", make, _file("a.mcap", lambda path: read_wheel(str(path)))),
    ]


def _models(scratch: Path) -> list[ReaderCase]:
    import torch

    from edgemap.export.adopt import load_onnx
    from edgemap.export.darknet import Darknet
    from edgemap.export.darknet_weights import load_weights, random_weights, save_weights
    from edgemap.export.detector.checkpoint import FORMAT
    from edgemap.export.detector.network import load_network
    from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head
    from edgemap.export.odometry.paper import PaperHead
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.manifest import MANIFEST_NAME, read_manifest, sha256_file
    from reliability.tiny_bundle import write_tiny

    folder = write_tiny(scratch / "tiny")
    manifest, model = json.loads((folder / MANIFEST_NAME).read_text()), (folder / "backbone.onnx").read_bytes()

    def summed(at: Path, data: bytes) -> object:
        (at / "backbone.onnx").write_bytes(data)
        document = manifest | {"sha256": {"backbone.onnx": sha256_file(at / "backbone.onnx")}}
        (at / MANIFEST_NAME).write_text(json.dumps(document))
        return load_bundle(at, threads=1)

    network = Darknet.from_cfg(CFG)
    random_weights(network)
    save_weights(network, scratch / "a.weights")
    weights = (scratch / "a.weights").read_bytes()
    torch.manual_seed(0)
    save_head(HeadCheckpoint(PaperHead((1, 2, 3, 3), (2,), 4), "tiny", "head"), scratch / "head.pt")
    packed = (scratch / "head.pt").read_bytes()
    tree = torch.load(scratch / "head.pt", weights_only=True)
    tree["state_dict"] = {name: tensor.tolist() for name, tensor in tree["state_dict"].items()}
    tree = json.loads(json.dumps(tree))

    def tensors(value: Any, random: Random) -> Any:
        try:
            made = torch.tensor(value, dtype=torch.float32)
        except (ValueError, TypeError, RuntimeError, OverflowError):
            return value
        return (
            made.to_sparse()
            if random.random() < 0.005
            else made.expand(2, *made.shape)
            if random.random() < 0.01
            else made
        )

    def checkpoint(random: Random) -> bytes:
        from io import BytesIO

        if random.random() < 0.4:
            return mutated_bytes(random, packed)
        document = mutated_tree(random, tree)
        held = document.get("state_dict") if isinstance(document, dict) else None
        if isinstance(held, dict):
            document["state_dict"] = {name: tensors(value, random) for name, value in held.items()}
        stream = BytesIO()
        torch.save(document, stream)
        return stream.getvalue()

    def onnx_file(random: Random) -> bytes:
        if random.random() < 0.8:
            return mutated_bytes(random, model)
        data = bytearray(model)  # one byte: the message most often stays whole
        data[random.randrange(len(data))] = random.randrange(256)
        return bytes(data)

    trained = manifest | {"sha256": {}}

    def detector(random: Random) -> bytes:
        from io import BytesIO

        graph = mutated_bytes(random, model) if random.random() < 0.3 else model
        held: Any = {"manifest": json_bytes(random, trained).decode(errors="replace"), "format": FORMAT}
        held = held if random.random() < 0.7 else mutated_tree(random, held)
        if isinstance(held, dict):
            held["graph"] = torch.frombuffer(bytearray(graph), dtype=torch.uint8)
        stream = BytesIO()
        torch.save(held, stream)
        return mutated_bytes(random, stream.getvalue()) if random.random() < 0.2 else stream.getvalue()

    return [
        ReaderCase(
            "bundle.json", lambda random: json_bytes(random, manifest),
            lambda at, data: (_file(MANIFEST_NAME, lambda path: read_manifest(path.parent)))(at, data),
        ),
        ReaderCase("ONNX in a bundle", lambda random: mutated_bytes(random, model), summed),
        ReaderCase("ONNX to adopt", onnx_file, _file("a.onnx", load_onnx)),
        ReaderCase(
            "Darknet weights",
            lambda random: mutated_bytes(random, weights[:20]) + weights[20:] if random.random() < 0.5
            else mutated_bytes(random, weights),
            _file("a.weights", lambda path: load_weights(network, path)),
        ),
        ReaderCase("checkpoint, odometry", checkpoint, _file("a.pt", load_head)),
        ReaderCase("checkpoint, detector", detector, _file("a.pt", lambda path: load_network(str(path)))),
    ]  # fmt: skip
