"""Pictures and recordings: valid files, mutated."""

import json
from io import BytesIO
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer

from edgemap.bridges.ros2.messages import build as messages
from edgemap.bridges.ros2.messages.definitions import definition
from edgemap.bridges.ros2.recordings.camera import RecordingCamera
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, Facts, facts_record
from edgemap.bridges.ros2.recordings.foreign import read_wheel
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.cameras.pictures import VideoCamera
from edgemap.runtime.inputs.drives.pictures import read_picture
from reliability.document_cases import drained
from reliability.mutations import json_bytes, mutated_bytes, mutated_tree
from reliability.workers import ReaderCase, from_file


def recording_cases(scratch: Path) -> list[ReaderCase]:
    """scratch: for the videos that are taken apart."""
    return [_pictures(), *_recordings(), _videos(scratch)]


def _pictures() -> ReaderCase:
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

    return ReaderCase("pictures", make, from_file("a.png", read_picture))


def _recordings() -> list[ReaderCase]:
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

    return [
        ReaderCase("MCAP, camera", make, from_file("a.mcap", lambda path: drained(RecordingCamera(str(path))))),
        ReaderCase("MCAP, wheels", make, from_file("a.mcap", lambda path: read_wheel(str(path)))),
    ]


def _videos(scratch: Path) -> ReaderCase:
    valid = []
    for name, code in (("a.mp4", "mp4v"), ("a.avi", "MJPG")):
        writer = cv2.VideoWriter(str(scratch / name), cv2.VideoWriter.fourcc(*code), 10.0, (64, 48))
        for shade in range(6):
            writer.write(np.full((48, 64, 3), 40 * shade, np.uint8))
        writer.release()
        valid.append((scratch / name).read_bytes())
    valid += [b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n", b"ffconcat version 1.0\nfile '/etc/passwd'\n"]

    def make(random: Random) -> bytes:
        return mutated_bytes(random, random.choice(valid))

    return ReaderCase("videos", make, from_file("video.mp4", lambda path: drained(VideoCamera("fuzz", path))))
