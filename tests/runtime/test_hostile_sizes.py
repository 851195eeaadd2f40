"""Small files that would take gigabytes or an endless while once read: refused, or read in bounded memory."""

import os
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.huge_png import png
from support.recordings import FACTS, noise, record

from edgemap.bridges.ros2.messages.definitions import definition
from edgemap.bridges.ros2.messages.tf_tree import TfTree
from edgemap.bridges.ros2.recordings import foreign
from edgemap.bridges.ros2.recordings.camera import RecordingCamera
from edgemap.bridges.ros2.recordings.facts import Facts
from edgemap.bridges.ros2.recordings.pictures import raw_picture
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.network.store import LENS, default_bundle

IDENTITY = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}

MEMORY = """
import resource, sys
from pathlib import Path
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.inputs.drives.truth import read_boxes
from edgemap.bridges.ros2.recordings.facts import read_trajectory_file
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + (400 << 20),) * 2)
path, empties = Path(sys.argv[1]), b"{}," * (5 << 20)
for text, read in (
    (b'{"format":[' + empties + b'1],"objects":[]}', load_map),
    (b'{"format":"edgemap.map/1","objects":[{"id":3}],"x":[' + empties + b"1]}", load_map),
    (b'{"frames":[' + empties + b"1]}", read_boxes),
    (b"[" + empties + b"1]", lambda path: read_trajectory_file(path.read_bytes(), "truth.json")),
):
    path.write_bytes(text)
    try:
        read(path)
    except EdgemapError as error:
        print(error)
"""


def test_what_is_wrong_in_a_large_document_is_told_without_reading_all_of_it_as_any_values(tmp_path):
    """15 MB of `{}` are 400 MB once they are Python's dictionaries."""
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(tmp_path / "x.json")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-400:]
    assert len(done.stdout.splitlines()) == 4


def bag(path, messages, **options):
    """An MCAP file of (topic, kind, stamp_ns, fields or bytes)."""
    from mcap.writer import Writer
    from mcap_ros2._dynamic import serialize_dynamic

    with path.open("wb") as file:
        writer, channels = Writer(file, **options), {}
        writer.start("ros2", "test")
        for topic, kind, stamp_ns, fields in messages:
            if (topic, kind) not in channels:
                name = kind.replace("/", "/msg/")
                schema = writer.register_schema(name, "ros2msg", definition(kind).encode())
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            data = fields if isinstance(fields, bytes) else serialize_dynamic(kind, definition(kind))[kind](fields)
            writer.add_message(channels[topic, kind], stamp_ns, bytes(data), stamp_ns)
        writer.finish()
    return path


def header(frame="lens"):
    return {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": frame}


def picture(**changes):
    fields = {"height": 4, "width": 4, "encoding": "bgr8", "is_bigendian": 0, "step": 12, "data": bytes(48)}
    return {"header": header()} | fields | changes


def transform(child, parent, rotation=IDENTITY):
    place = {"x": 0.0, "y": 0.0, "z": 0.5}
    return {
        "header": header(parent), "child_frame_id": child,
        "transform": {"translation": place, "rotation": rotation},
    }  # fmt: skip


@pytest.mark.parametrize("encoding", ["yuv422", "yuyv", "uyvy", "yuv422_yuy2"])
def test_a_picture_whose_colours_come_in_pairs_has_an_even_width(encoding):
    """OpenCV asserts that, in eight lines."""
    message = SimpleNamespace(encoding=encoding, width=3, height=2, step=6, data=bytes(12))
    with pytest.raises(CameraError, match=f"Image of 3x2 px {encoding}"):
        raw_picture(message, "a.mcap picture 0")


def test_a_camera_that_looks_straight_down_by_tf_has_a_mount_or_none(tmp_path):
    """Two rotations that make 90 degrees together give a sine a little above 1."""
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    down = Rotation.from_euler("y", 90.0 - 1e-7, degrees=True).as_matrix() @ optical
    steepest = 0.0
    for seed in range(40):
        half = Rotation.from_euler("xyz", np.random.default_rng(seed).uniform(-3.0, 3.0, 3))
        rest = Rotation.from_matrix(half.as_matrix().T @ down)
        turns = [dict(zip("xyzw", turn.as_quat().tolist(), strict=True)) for turn in (half, rest)]
        tf = {"transforms": [transform("middle", foreign.FLOOR_FRAME, turns[0]), transform("lens", "middle", turns[1])]}
        tree = TfTree("a")
        tree.add(as_namespace(tf))
        foreign.mount_of(tree, "lens")
        product = (
            Rotation.from_quat(list(turns[0].values())).as_matrix()
            @ Rotation.from_quat(list(turns[1].values())).as_matrix()
        )
        steepest = max(steepest, -product[2, 2])
    assert steepest > 1.0  # one of them did


def as_namespace(value):
    if isinstance(value, dict):
        return SimpleNamespace(**{name: as_namespace(item) for name, item in value.items()})
    return [as_namespace(item) for item in value] if isinstance(value, list) else value


def edited(path, old, new):
    data = path.read_bytes()
    assert len(old) == len(new)
    assert old in data
    path.write_bytes(data.replace(old, new))
    return path


def test_a_topic_of_two_kinds_is_refused(tmp_path):
    """What is read of its messages follows from the kind that the topic has."""
    messages = [
        ("/image", "sensor_msgs/Image", 1, picture()),
        ("/imu", "sensor_msgs/Imu", 2, bytes(400)),
        ("/imu", "std_msgs/Float64", 1, {"data": 1.0}),
    ]
    with pytest.raises(CameraError, match=r"a\.mcap: /imu is \S+ and \S+; a topic has one kind"):
        RecordingCamera(str(bag(tmp_path / "a.mcap", messages)))


def test_names_of_topics_that_a_terminal_would_act_on_are_refused(tmp_path):
    for index_types in ({}, {"use_chunking": False}):
        path = bag(
            tmp_path / "a.mcap", [("/imagexyz", "sensor_msgs/Image", 1, picture())], enable_crcs=False, **index_types
        )
        with pytest.raises(CameraError, match="name does not print") as caught:
            RecordingCamera(str(edited(path, b"/imagexyz", b"/\x1b[2Jxyz\n")))
        assert str(caught.value).isprintable()


def test_a_recording_that_says_it_was_made_from_itself(tmp_path):
    path = tmp_path / "a.mcap"
    record(path, Facts(str(path), FACTS.intrinsics, FACTS.mount, 10.0), noise(1))
    assert default_bundle(recorded_from(str(path)))[0] == LENS


def test_a_first_picture_that_is_damaged_is_told(tmp_path):
    path = bag(tmp_path / "a.mcap", [("/image", "sensor_msgs/Image", 1, picture(encoding="yuyv", width=3, step=6))])
    with pytest.raises(CameraError, match=r"/image has no complete picture, 1 damaged: .* Image of 3x4 px yuyv"):
        RecordingCamera(str(path))


def avi(path, pictures, width, height):
    """A video of PNG pictures whose headers say this size."""

    def chunk(kind, data):
        return kind + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)

    count = len(pictures)
    stream = b"vidsMPNG" + struct.pack(
        "<IHHIIIIIIII4h", 0, 0, 0, 0, 1, 10, 0, count, 1 << 20, 0, 0, 0, 0, width, height
    )
    form = struct.pack("<IiiHH4sIiiII", 40, width, height, 1, 24, b"MPNG", 3 * width * height, 0, 0, 0, 0)
    head = struct.pack("<14I", 100_000, 0, 0, 0, count, 0, 1, 1 << 20, width, height, 0, 0, 0, 0)
    streams = chunk(b"LIST", b"strl" + chunk(b"strh", stream) + chunk(b"strf", form))
    movie = chunk(b"LIST", b"movi" + b"".join(chunk(b"00dc", picture) for picture in pictures))
    path.write_bytes(chunk(b"RIFF", b"AVI " + chunk(b"LIST", b"hdrl" + chunk(b"avih", head) + streams) + movie))
    return path


VIDEO = """
import resource, sys
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.inputs.open import open_camera
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    with open_camera(sys.argv[1]) as camera:
        while (frame := camera.read()) is not None:
            print(frame.image.shape)
except EdgemapError as error:
    print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


@pytest.mark.parametrize(
    ("size", "said", "text"),
    [
        ((9000, 9000), (9000, 9000), "video of 9000x9000 px, at most 67,108,864 px are decoded"),
        ((21000, 21000), (21000, 21000), "video"),
        ((21000, 21000), (64, 48), "video"),
    ],
)
def test_a_small_video_of_huge_pictures_is_refused_in_bounded_memory(tmp_path, size, said, text):
    path = avi(tmp_path / "a.avi", [png(*size)], *said)
    assert path.stat().st_size < 4 << 20
    done = subprocess.run([sys.executable, "-c", VIDEO, str(path)], capture_output=True, text=True, check=False)
    told, taken_mb = done.stdout.splitlines()
    assert text in told
    assert int(taken_mb) < 1100
    assert done.stderr == ""


def test_a_huge_picture_in_the_middle_of_a_video_costs_bounded_memory(tmp_path):
    small = png(64, 48)
    path = avi(tmp_path / "a.avi", [small, small, small, png(21000, 21000), small, small], 64, 48)
    done = subprocess.run([sys.executable, "-c", VIDEO, str(path)], capture_output=True, text=True, check=False)
    *shapes, taken_mb = done.stdout.splitlines()
    assert set(shapes) == {"(48, 64, 3)"}
    assert len(shapes) >= 3
    assert int(taken_mb) < 1100


BOUND = """
import resource
from edgemap.runtime.frames.quiet import bounded_memory

before = resource.getrlimit(resource.RLIMIT_AS)
try:
    with bounded_memory(64 << 20):
        bytearray(256 << 20)
except MemoryError:
    print("refused")
print(resource.getrlimit(resource.RLIMIT_AS) == before, len(bytearray(256 << 20)) == 256 << 20)
"""


def test_the_bound_on_memory_is_lifted_again():
    """In a process of its own: a long one holds free memory that it need not ask for."""
    done = subprocess.run([sys.executable, "-c", BOUND], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["refused", "True", "True"]


def test_a_picture_whose_name_a_terminal_would_act_on_is_refused(tmp_path):
    for name in ("a\x1b[2J.png", "a\nb.png", os.fsdecode(b"\xff.png")):
        folder = tmp_path / f"{len(name)}{ord(name[0])}"
        folder.mkdir()
        (folder / name).write_bytes(b"")
        with pytest.raises(CameraError, match="characters that do not print") as caught:
            list_pictures(folder)
        assert str(caught.value).isprintable()
