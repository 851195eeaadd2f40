"""Damaged recordings and messages: read to valid values, or refused in one line."""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType
from support.mutations import MUTATED, drained, mutated_bytes, mutated_json, mutated_tree, refused_or
from support.recordings import FACTS, LENS, MOUNT, bag, drain, noise, record

from edgemap.bridges.ros2.messages import build
from edgemap.bridges.ros2.messages.definitions import DAMAGE, decoder, encoder
from edgemap.bridges.ros2.recordings import foreign
from edgemap.bridges.ros2.recordings.camera import recording_camera
from edgemap.bridges.ros2.recordings.facts import facts_record, read_facts, read_trajectory_file
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.spatial_poses import pose_of
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.network.store import LENS as LENS_BUNDLE
from edgemap.runtime.network.store import default_bundle

WHEEL = Trajectory(np.arange(8) / 10, tuple(SE2(i / 20, 0.1, 0.2) for i in range(8)))
PNG = cv2.imencode(".png", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def header(frame="lens"):
    return {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": frame}


def picture(**changes):
    fields = {"height": 4, "width": 4, "encoding": "bgr8", "is_bigendian": 0, "step": 12, "data": bytes(48)}
    return {"header": header()} | fields | changes


def sent(stamp_ns: int) -> list[tuple[str, str, int, Any]]:
    raw = {"header": build.header(stamp_ns, "camera"), "height": 48, "width": 64, "encoding": "bgr8", "step": 192}
    raw |= {"is_bigendian": 0, "data": bytes(9216)}
    messages = [
        ("/tf", "tf2_msgs/msg/TFMessage", build.tf(build.mount_transform(stamp_ns, MOUNT))),
        ("/camera/camera_info", "sensor_msgs/msg/CameraInfo", build.camera_info(stamp_ns, LENS)),
        ("/wheel/odometry", "nav_msgs/msg/Odometry", build.odometry(stamp_ns, SE2(stamp_ns / 1e9, 0.1, 0.2))),
        ("/imu", "sensor_msgs/msg/Imu", build.imu(stamp_ns, [0.1, 0.2, 0.3], [0.0, 9.8, 0.1])),
        ("/image/compressed", "sensor_msgs/msg/CompressedImage", build.compressed_image(stamp_ns, PNG, "png")),
        ("/image_raw", "sensor_msgs/msg/Image", raw),
    ]
    return [(topic, kind, stamp_ns, message) for topic, kind, message in messages]


LAYOUTS: tuple[dict[str, Any], ...] = (
    {"compression": CompressionType.NONE, "chunk_size": 4000},
    {"compression": CompressionType.LZ4, "enable_crcs": False},
    {"compression": CompressionType.ZSTD, "chunk_size": 4000},
    {"index_types": IndexType.NONE, "compression": CompressionType.NONE, "enable_crcs": False},
    {"use_chunking": False, "enable_crcs": False},
)


@cache
def valid(folder: Path, layout: int) -> bytes:
    if layout == len(LAYOUTS):
        return record(folder / "ours.mcap", FACTS, noise(3), wheel=WHEEL, truth=WHEEL).read_bytes()
    messages = [message for number in range(3) for message in sent(10**9 + number * 10**8)]
    return bag(folder / f"{layout}.mcap", messages, **LAYOUTS[layout]).read_bytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("recordings")


def use_wheel(path: Path) -> None:
    trajectory = foreign.read_wheel(str(path))
    assert np.isfinite([pose.vector() for pose in trajectory.poses]).all()
    assert (np.diff(trajectory.stamps_s) > 0.0).all()


@pytest.mark.parametrize("layout", range(len(LAYOUTS) + 1))
@MUTATED
@given(data=st.data())
def test_a_damaged_recording_is_read_or_refused_in_one_line(folder, layout, data):
    path = folder / "damaged.mcap"
    path.write_bytes(data.draw(mutated_bytes(valid(folder, layout))))
    refused_or(lambda: drained(recording_camera(str(path))))
    refused_or(use_wheel, path)


@MUTATED
@given(data=st.data())
def test_a_recording_of_wrong_messages_is_read_or_refused_in_one_line(folder, data):
    messages = []
    for topic, kind, stamp_ns, fields in [*sent(10**9), *sent(2 * 10**9)]:
        coded = encoder(kind)(fields)
        try:
            coded = encoder(kind)(data.draw(mutated_tree(fields)))
        except Exception:  # what no message can hold
            coded = data.draw(mutated_bytes(coded[:200])) + coded[200:]
        messages.append((topic, kind, stamp_ns, bytes(coded)))
    path = bag(folder / "wrong.mcap", messages)
    refused_or(lambda: drained(recording_camera(str(path))))
    refused_or(use_wheel, path)


@MUTATED
@given(data=st.data())
def test_wrong_facts_are_read_or_refused_in_one_line(data):
    facts = data.draw(mutated_tree(facts_record(FACTS)))
    refused_or(read_facts, {name: f"{value}" for name, value in facts.items()}, "a.mcap")
    rows = data.draw(mutated_json([[i / 10, i / 20, 0.1, 0.2] for i in range(5)]))
    read = refused_or(read_trajectory_file, rows, "a.mcap")
    assert read is None or np.isfinite([pose.vector() for pose in read.poses]).all()


@pytest.mark.parametrize("kind", sorted({kind for _, kind, _, _ in sent(0)}))
@MUTATED
@given(data=st.data())
def test_a_damaged_message_from_the_network_raises_what_is_caught(kind, data):
    message = next(fields for _, name, _, fields in sent(10**9) if name == kind)
    with suppress(*DAMAGE):
        decoder(kind)(data.draw(mutated_bytes(encoder(kind)(message)[:400])))


def test_a_camera_that_looks_straight_down_by_tf_has_a_mount_or_none():
    """Two rotations that make 90 degrees together give a sine a little above 1."""
    for ahead in (1e-9, -1e-9):
        down = np.array([[0.0, 0.0, ahead], [-1.0, 0.0, 0.0], [0.0, -1e-9, -1.0 - 4e-16]])
        tree: Any = SimpleNamespace(pose=lambda *_: pose_of(down, np.array([0.0, 0.0, 0.5])))  # noqa: B023
        mount, text = foreign.mount_of(tree, "lens")
        assert mount or "looking 90.0 deg down" in text


def test_a_topic_of_two_kinds_is_refused(tmp_path):
    """What is read of its messages follows from the kind that the topic has."""
    messages = [("/image", "sensor_msgs/msg/Image", 1, picture()), ("/image", "std_msgs/msg/Float64", 2, {"data": 1.0})]
    with pytest.raises(CameraError, match=r"a\.mcap: /image is \S+ and \S+; a topic has one kind"):
        drain(recording_camera(str(bag(tmp_path / "a.mcap", messages))))


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}])
def test_names_of_topics_that_a_terminal_would_act_on_are_refused(tmp_path, options):
    messages = [("/imagexyz", "sensor_msgs/msg/Image", 1, picture())]
    path = bag(tmp_path / "a.mcap", messages, enable_crcs=False, **options)
    path.write_bytes(path.read_bytes().replace(b"/imagexyz", b"/\x1b[2Jxyz\n"))
    with pytest.raises(CameraError, match="name does not print") as caught:
        recording_camera(str(path))
    assert str(caught.value).isprintable()


def test_a_recording_that_says_it_was_made_from_itself(tmp_path):
    path = tmp_path / "a.mcap"
    record(path, replace(FACTS, name=str(path)), noise(1))
    assert default_bundle(recorded_from(str(path)))[0] == LENS_BUNDLE


def test_a_first_picture_that_is_damaged_is_reported(tmp_path):
    path = bag(tmp_path / "a.mcap", [("/image", "sensor_msgs/msg/Image", 1, picture(encoding="yuyv", width=3, step=6))])
    with pytest.raises(CameraError, match=r"/image has no complete picture, 1 damaged: .* Image of 3x4 px yuyv"):
        recording_camera(str(path))
