"""A client of Foxglove's WebSocket protocol that shares no code with the server reads what a run publishes."""

import base64
import json
import math
import struct
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.boxed_room import walls
from support.faults import made
from support.recordings import LENS, MOUNT
from support.steps import Steps

from edgemap.bridges.ros2.messages import stream
from edgemap.bridges.ros2.messages.stream import MessageStream
from edgemap.bridges.ros2.messages.topics import FrameIds
from edgemap.runtime.frames.errors import BridgeError

pytest.importorskip("foxglove")
client = pytest.importorskip("websockets.sync.client")
typesys = pytest.importorskip("rosbags.typesys")

from edgemap.bridges.foxglove.sink import FoxgloveServer  # noqa: E402


class Client:
    """Subscribes to all that is advertised; decodes ROS 2 messages with rosbags, by the schemas that were sent."""

    def __init__(self, url):
        self._connection = client.connect(url, subprotocols=["foxglove.sdk.v1"])
        self._socket = self._connection.__enter__()
        assert self._socket.subprotocol == "foxglove.sdk.v1"
        self.info = self._json("serverInfo")
        self.channels = {channel["topic"]: channel for channel in self._json("advertise")["channels"]}
        self._store = typesys.get_typestore(typesys.Stores.EMPTY)
        self.time_ns, self.statuses = 0, []

    def _json(self, operation):
        message = json.loads(self._socket.recv(timeout=60))
        assert message["op"] == operation
        return message

    def subscribe(self, *topics):
        ids = [{"id": 100 + self.channels[topic]["id"], "channelId": self.channels[topic]["id"]} for topic in topics]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": ids}))
        self._socket.ping().wait(60)  # the server has taken it in

    def until(self, stamp_s):
        """(topic, stamp in ns, data) of all messages until the server's time reaches the stamp, which may overtake some
        of them."""
        found, names = [], {100 + channel["id"]: topic for topic, channel in self.channels.items()}
        while True:
            try:
                message = self._socket.recv(timeout=60 if self.time_ns < round(stamp_s * 1e9) else 0.5)
            except TimeoutError:
                assert self.time_ns >= round(stamp_s * 1e9)
                return found
            if isinstance(message, str):
                self.statuses.append(json.loads(message))
            elif message[0] == 2:
                (self.time_ns,) = struct.unpack("<Q", message[1:9])
            else:
                assert message[0] == 1
                subscription, stamp_ns = struct.unpack("<IQ", message[1:13])
                found.append((names[subscription], stamp_ns, message[13:]))

    def decode(self, topic, data):
        channel = self.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        name = channel["schemaName"]
        self._store.register(typesys.get_types_from_msg(channel["schema"], name))
        return self._store.deserialize_cdr(data, name)

    def close(self):
        self._connection.__exit__(None, None, None)


@pytest.fixture
def server():
    with closing(FoxgloveServer("127.0.0.1", 0, MessageStream(LENS, MOUNT))) as opened:
        yield opened


def test_a_client_reads_poses_objects_pictures_and_boxes(server):
    steps = Steps(boxes=walls(-1.0, -2.0, 4.0, 2.0))
    steps.into(server, 3)
    with closing(Client(server.url)) as viewer:
        assert viewer.info["capabilities"] == ["time"]  # no client publishes, calls or changes anything
        viewer.subscribe(*viewer.channels)
        drawn = [steps.next() for _ in range(10)]
        for result, objects in drawn[:-1]:
            server.write(result, objects)
        found = viewer.until(1.1)
        result, objects = drawn[-1]
        late = replace(result.observed.detections, scores=np.full(3, 0.5))
        server.last(replace(result, observed=replace(result.observed, detections=late)), objects)
        server.write(result, objects)
        found += viewer.until(1.2)
        decoded = {}
        for topic, stamp_ns, data in found:
            if topic != "/detections/annotations":
                message = viewer.decode(topic, data)
                decoded.setdefault(topic, []).append((stamp_ns, message))
    assert set(decoded) == {topic for topic in viewer.channels if topic != "/detections/annotations"}
    result, objects = drawn[4]
    stamp_ns, picture = decoded["/camera/image/compressed"][4]
    assert stamp_ns == 700_000_000
    assert (picture.header.stamp.nanosec, picture.header.frame_id) == (700_000_000, "camera_optical_frame")
    expected = cv2.imencode(".jpg", result.frame.image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    np.testing.assert_array_equal(picture.data, expected)
    pose = decoded["/pose"][4][1].pose.pose
    assert (pose.position.x, pose.position.y) == (result.pose_map_base.x_m, result.pose_map_base.y_m)
    tree = {(t.header.frame_id, t.child_frame_id) for _, message in decoded["/tf"] for t in message.transforms}
    assert tree == {("map", "odom"), ("odom", "base_link"), ("base_link", "camera_optical_frame")}
    ellipses = [marker for marker in decoded["/map/markers"][0][1].markers if marker.ns == "ellipses"]
    assert len(ellipses) == len(objects) == 2
    item = min(objects, key=lambda item: abs(item.position_m[0] - ellipses[0].pose.position.x))
    axis_m = 2.0 * math.sqrt(5.991 * np.linalg.eigvalsh(item.covariance_m2)[-1])
    assert ellipses[0].scale.x == pytest.approx(axis_m, rel=0.05)  # of the map some steps before
    boxes = decoded["/detections"][4][1].detections
    assert [box.results[0].hypothesis.class_id for box in boxes] == ["chair", "couch", "person"]
    assert [box.results[0].hypothesis.score for box in decoded["/detections"][9][1].detections] == [0.5] * 3
    assert [stamp_ns for stamp_ns, _ in decoded["/map/objects"]] == [1_000_000_000, 1_200_000_000]


def test_the_layout_shows_topics_that_are_sent_in_panels_that_take_their_types(server):
    """Every panel is drawn once, and takes the type of its topics by Foxglove's documentation."""
    layout = json.loads((Path(__file__).parents[3] / "deploy/foxglove-layout.json").read_text())
    with closing(Client(server.url)) as viewer:
        kinds = {topic: channel["schemaName"].split("/")[-1] for topic, channel in viewer.channels.items()}
        viewer.subscribe("/pose")
        Steps().into(server, 2)
        pose = viewer.decode(*next((topic, data) for topic, _, data in viewer.until(0.1)))
    panels, drawn = layout["configById"], list[str]()
    waiting = [layout["layout"]]
    while waiting:
        if isinstance(part := waiting.pop(), str):
            drawn.append(part)
        else:
            waiting += [part["first"], part["second"]]
    assert sorted(drawn) == sorted(panels)
    three, image = panels["3D!map"], panels["Image!camera"]["imageMode"]
    drawable = {"OccupancyGrid", "MarkerArray", "LaserScan", "PoseWithCovarianceStamped", "Odometry", "CameraInfo"}
    assert {kinds[topic] for topic in three["topics"]} == drawable
    assert three["followTf"] == FrameIds().map
    assert {f"frame:{FrameIds().optical}"} == set(three["transforms"])
    assert kinds[image["imageTopic"]] == "CompressedImage"
    assert kinds[image["calibrationTopic"]] == "CameraInfo"
    assert [kinds[topic] for topic in image["annotations"]] == ["foxglove.ImageAnnotations"]
    assert kinds[panels["RawMessages!objects"]["topicPath"]] == "Detection3DArray"
    for path in panels["Plot!pose"]["paths"]:
        topic, names = path["value"].split(".", 1)
        assert (topic, isinstance(eval(f"pose.{names}", {"pose": pose}), float)) == ("/pose", True)


def test_annotations_hold_every_box(server):
    descriptors = pytest.importorskip("google.protobuf.descriptor_pb2")
    factory = pytest.importorskip("google.protobuf.message_factory")
    with closing(Client(server.url)) as viewer:
        channel = viewer.channels["/detections/annotations"]
        assert (channel["encoding"], channel["schemaName"]) == ("protobuf", "foxglove.ImageAnnotations")
        viewer.subscribe("/detections/annotations")
        steps, found = Steps(), []
        for index in range(50):  # the server answers a ping before it has subscribed, on a busy machine
            steps.into(server, 1)
            found += viewer.until(0.1 * index)
            if found:
                break
        (_, _, data) = found[-1]
    files = descriptors.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file
    message = factory.GetMessages(files)["foxglove.ImageAnnotations"].FromString(data)
    assert [text.text[:10] for text in message.texts] == ["chair 0.90", "couch 0.80", "person 0.7"]
    assert [(point.x, point.y) for point in message.points[0].points] == [(40, 60), (90, 60), (90, 160), (40, 160)]


def test_without_subscribers_nothing_is_built(server, monkeypatch):
    def built(*_):
        raise AssertionError("built for nobody")

    monkeypatch.setattr(stream, "encoded", built)
    for name in ("camera_info", "tf", "pose", "step_odometry", "detections_2d"):
        monkeypatch.setattr(stream.build, name, built)
    monkeypatch.setattr(stream, "markers", built)
    with closing(Client(server.url)) as viewer:
        Steps().into(server, 12)
        assert viewer.until(1.1) == []


def test_a_client_that_stops_reading_holds_up_neither_the_run_nor_its_end():
    """The server by itself waits 40 s for such a client's farewell."""
    server = FoxgloveServer("127.0.0.1", 0, MessageStream(LENS, MOUNT))
    connection = client.connect(server.url, subprotocols=["foxglove.sdk.v1"], max_queue=1)
    socket = connection.__enter__()
    socket.recv()
    channels = [item["id"] for item in json.loads(socket.recv())["channels"]]
    wish = [{"id": channel, "channelId": channel} for channel in channels]
    socket.send(json.dumps({"op": "subscribe", "subscriptions": wish}))
    while not server.annotations.has_sinks():
        time.sleep(0.01)
    steps = Steps(640, 480)  # noise: 0.4 MB a picture, more than the system's buffers hold of them
    steps.into(server, 60)
    begun_s = time.monotonic()
    server.close()
    server.close()
    assert time.monotonic() - begun_s < 30.0


def test_faults_reach_the_viewer(server):
    with closing(Client(server.url)) as viewer:
        server.fault(made("wheels: silent for 1.2 s"))
        Steps().into(server, 2)
        viewer.until(0.1)
        assert [status["message"] for status in viewer.statuses] == ["wheels: silent for 1.2 s"]


def test_what_a_client_sends_reaches_no_terminal(server, caplog):
    with closing(Client(server.url)) as viewer:
        viewer._socket.send(json.dumps({"op": "\x1b]0;title\x07"}))
        assert "unknown variant" in viewer._json("status")["message"]
    assert caplog.records == []


def test_an_address_that_is_taken_is_one_line(server):
    port = int(server.url.rsplit(":", 1)[1])
    with pytest.raises(BridgeError, match=rf"^--foxglove 127\.0\.0\.1:{port}: .*in use"):
        FoxgloveServer("127.0.0.1", port, MessageStream())
