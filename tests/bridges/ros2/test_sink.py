"""What `--ros2` publishes, through Cyclone DDS within one process."""

import json
import math
import os
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest
from support.boxed_room import walls
from support.recordings import noise
from support.results import CHAIR, POSES, results, run_info
from support.steps import Steps

from edgemap.geometry.objects.events import EditError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError, CameraState
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.mapper import Mapper

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (extra 'ros2')")
from edgemap.bridges.ros2.dds.discovery import Discovery
from edgemap.bridges.ros2.dds.node import Node, Publisher, Reliability, Subscription
from edgemap.bridges.ros2.messages import build
from edgemap.bridges.ros2.messages.diagnostics import RunDiagnostics
from edgemap.bridges.ros2.messages.topics import FrameIds
from edgemap.bridges.ros2.sink import Ros2Options, Ros2Sink, pose_edit

DOMAIN = 1 + (os.getpid() + 50) % 100  # not that of test_fastdds, which a failed test keeps open
TF = ("/tf", "tf2_msgs/msg/TFMessage")


@pytest.fixture(scope="module")
def node() -> Node:
    return Node(Discovery(DOMAIN, "OFF"))


def sink_of(node: Node, *arguments, **options) -> Ros2Sink:
    return Ros2Sink(node, run_info(), Ros2Options(*arguments, **options))


def taken(reader: Any, count: int) -> list:
    found: list = []
    until_s = time.monotonic() + 60.0
    while len(found) < count and time.monotonic() < until_s:
        if reader.wait(0.1):
            found += reader.take()
    assert len(found) == count
    return found


def links(message: Any) -> dict:
    return {(step.header.frame_id, step.child_frame_id): step.transform for step in message.transforms}


def test_what_nobody_reads_is_not_built(node, monkeypatch):
    """Boxes and poses cost nothing without a reader; maps are kept for later ones, one in ten steps."""
    built: list[str] = []
    monkeypatch.setattr(build, "detections_2d", lambda *_: built.append("boxes"))
    monkeypatch.setattr(build, "step_odometry", lambda *_: built.append("odometry"))
    stream = "edgemap.bridges.ros2.messages.stream"
    monkeypatch.setattr(f"{stream}.encoded", lambda *_: built.append("picture"))
    monkeypatch.setattr(f"{stream}.markers", lambda *_: built.append("map") or {"markers": []})
    sink = sink_of(node, "nobody", pictures=True)
    for result in results(noise(12), POSES):
        sink.write(result, [CHAIR])
    assert built == ["map", "map"]
    sink.close()


def test_namespace_and_frames_are_options(node):
    frames = FrameIds("world", "odom_vision", "base_footprint", "lens")
    sink = sink_of(node, "/fleet/robot7/", frames=frames)
    tf = Subscription(node, *TF)
    pose = Subscription(node, "/fleet/robot7/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    (result,) = results(noise(1), POSES[:1])
    sink.write(result, [CHAIR])
    assert set(links(taken(tf, 1)[0])) == {("world", "odom_vision"), ("odom_vision", "base_footprint")}
    assert taken(pose, 1)[0].header.frame_id == "world"
    static = Subscription(node, "/tf_static", TF[1], Reliability.LATCHED)  # comes late
    assert set(links(taken(static, 1)[0])) == {("base_footprint", "lens")}
    sink.close()


def test_the_floor_is_map_of_the_usual_namespace_and_of_its_own_in_another_one(node):
    """A planner that starts late gets the grid that was there before it; the scan is for those who listen."""
    for namespace, topic in (("edgemap", "/map"), ("robot7", "/robot7/map")):
        sink = sink_of(node, namespace)
        scans = Subscription(node, f"/{namespace}/floor_scan", "sensor_msgs/msg/LaserScan")
        Steps(boxes=[*walls(-1.0, -2.0, 4.0, 2.0), (2.0, -0.5, 2.5, 0.5, 0.8)]).into(sink, 22)
        late = Subscription(node, topic, "nav_msgs/msg/OccupancyGrid", Reliability.LATCHED)
        grid = taken(late, 1)[0]
        assert {0, 100, -1} <= set(grid.data)
        assert len(grid.data) == grid.info.width * grid.info.height
        assert scans.wait(60.0)
        assert next(scans.take()).header.frame_id == "base_link"
        sink.close()


def test_beside_a_robot_that_publishes_its_own_odometry_only_map_to_odom_is_sent(node):
    """map -> odom (ours) times odom -> base_link (the robot's, between its own stamps) is our pose in the map."""
    sink, reader, robot = sink_of(node, odom_tf=False), Subscription(node, *TF), Publisher(node, *TF)
    frames = noise(2)
    first, second = results(frames, POSES[:2])
    sink.write(first, [])  # the robot has said nothing yet
    for index, x_m in enumerate((7.0, 7.3, 7.6)):
        stamp_ns = round((frames[0].stamp_s + 0.02 * index) * 1e9)
        robot.write(build.tf(build.planar_transform(stamp_ns, "odom", "base_link", SE2(x_m, 0.0, 0.5))))
    sink.write(second, [])  # at 33 ms
    sent = [message for message in taken(reader, 4) if ("map", "odom") in links(message)]
    assert [set(links(message)) for message in sent] == [{("map", "odom")}]
    (step,) = sent[0].transforms
    at, q = step.transform.translation, step.transform.rotation
    ours = SE2(at.x, at.y, 2.0 * math.atan2(q.z, q.w))
    pose = ours @ SE2(7.0 + 0.3 * (frames[1].stamp_s - frames[0].stamp_s) / 0.02, 0.0, 0.5)
    assert pose.vector() == pytest.approx(POSES[1].vector(), abs=1e-6)


def test_a_pose_of_rviz_is_an_edit(node):
    """2D Pose Estimate: x 1 m, y 2 m, a quarter turn, sigma 0.5 m and 15 degrees; in another frame it is none."""
    run = run_info()
    sink, got = Ros2Sink(node, run, Ros2Options("rviz")), run.edits._waiting
    rviz = Publisher(node, "/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = 0.25
    covariance[35] = math.radians(15.0) ** 2
    half = math.sqrt(0.5)
    pose = {"position": {"x": 1.0, "y": 2.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": half, "w": half}}
    (result, *_), objects = list(results(noise(1), POSES[:1])), [CHAIR]
    until_s = time.monotonic() + 60.0
    for frame in ("odom", "map"):
        message = {"header": {"frame_id": frame}, "pose": {"pose": pose, "covariance": covariance}}
        while (frame == "odom" and not rviz.wanted) or (frame == "map" and not got):
            assert time.monotonic() < until_s
            rviz.write(message)
            sink.write(result, objects)
            time.sleep(0.01)
    (edit, _), *_ = got
    assert edit.do == "pose"
    assert edit.pose == pytest.approx((1.0, 2.0, math.pi / 2))
    assert edit.sigmas == pytest.approx((0.5, 0.5, math.radians(15.0)))
    for _, answer in got:
        answer.set_exception(EditError("too far"))
    with pytest.raises(BridgeError, match=r"^/initialpose: too far$"):
        sink.write(result, objects)
    sink.close()


@pytest.mark.parametrize("value", [1e308, math.inf, -math.inf, math.nan])
def test_a_pose_that_cannot_be_is_an_edit_that_is_refused(value):
    """As RViz's neighbours send it: no number of it ends the run."""
    point, turned = SimpleNamespace(x=value, y=value, z=value), SimpleNamespace(x=value, y=value, z=value, w=value)
    pose = SimpleNamespace(pose=SimpleNamespace(position=point, orientation=turned), covariance=[value] * 36)
    edits, mapper = Edits(), Mapper()
    asked = edits.submit(pose_edit(SimpleNamespace(pose=pose)))
    assert edits.apply(mapper, 0) == []
    assert isinstance(asked.exception(), EditError)


def test_a_goal_is_published_with_the_next_step(node):
    reader = Subscription(node, "/goal_pose", "geometry_msgs/msg/PoseStamped", Reliability.RELIABLE)
    sink = sink_of(node, "goes")
    (result,) = results(noise(1), POSES[:1])
    until_s = time.monotonic() + 60.0
    while not reader.wait(0.01) and time.monotonic() < until_s:  # until each has found the other
        sink.send_goal(SE2(1.0, -2.0, math.pi / 2))
        sink.write(result, [CHAIR])
    goal, *_ = reader.take()
    assert (goal.header.frame_id, goal.pose.position.x, goal.pose.position.y) == ("map", 1.0, -2.0)
    assert goal.pose.orientation.z == pytest.approx(math.sqrt(0.5))
    sink.close()


READER = """
import json, sys, time
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from edgemap.bridges.ros2.dds.types import dds_topic, sample_type
from edgemap.bridges.ros2.messages.definitions import decoder

participant, readers = DomainParticipant(int(sys.argv[1])), {}
topics = {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray", "/edgemap/labels": "vision_msgs/msg/LabelInfo"}
for name, kind in topics.items():
    latched = Policy.Durability.TransientLocal if name == "/edgemap/labels" else Policy.Durability.Volatile
    cdr = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
    qos = Qos(Policy.Reliability.Reliable(10**8), latched, cdr)
    readers[kind] = DataReader(participant, Topic(participant, dds_topic(name), sample_type(kind)), qos)
while len(readers):
    for kind, reader in list(readers.items()):
        for sample in reader.take(10):
            message = decoder(kind)(sample.cdr)
            if kind.startswith("vision"):
                rows = [(one.class_id, one.class_name) for one in message.class_map], message.threshold
            else:
                rows = [(one.name, one.level, one.message, one.hardware_id) for one in message.status], 0
            print(json.dumps([kind, *rows]))
            readers.pop(kind, None)
    time.sleep(0.05)
"""


def test_a_cyclone_participant_with_its_defaults_reads_diagnostics_and_classes(tmp_path):
    """Of `edgemap run --ros2` as typed, from another process, neither with any configuration."""
    environment = {name: text for name, text in os.environ.items() if name != "CYCLONEDDS_URI"}
    environment |= {"ROS_DOMAIN_ID": str(DOMAIN + 100), "EDGEMAP_ROBOT": "vacuum"}
    command = [sys.executable, "-m", "edgemap.cli", "run", "--ros2", "--out", str(tmp_path / "run")]
    words = [sys.executable, "-c", READER, str(DOMAIN + 100)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as reader:
        run = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        try:
            said, _ = reader.communicate(timeout=200.0)
        finally:
            reader.kill()
            run.terminate()
            _, printed = run.communicate(timeout=60.0)
    found = {kind: rows for kind, *rows in map(json.loads, said.splitlines())}
    labels, threshold = found["vision_msgs/msg/LabelInfo"]
    statuses, _ = found["diagnostic_msgs/msg/DiagnosticArray"]
    assert [5, "chair"] in labels
    assert 0.0 < threshold < 1.0
    named = {name: (level, text, robot) for name, level, text, robot in statuses}
    assert named["edgemap: camera"] == (0, "running", "vacuum")
    assert named["edgemap: map"][1].startswith("map: ")
    assert named["edgemap: pose"][0] in (0, 1)
    assert f"domain {DOMAIN + 100}, this machine; topics /tf, " in printed


def test_diagnostics_name_each_kind_of_fault_and_warn_while_it_is_new():
    diagnostics = RunDiagnostics("kitchen", "robo")
    for text, at_s in (("a", 1.0), ("b", 2.0)):
        diagnostics.fault(Fault(FaultKind.DARK, text), at_s)
    diagnostics.fault(Fault(FaultKind.RECOVERED, "back"), 2.0)
    levels = []
    for now_s in (3.0, 8.0):
        message = diagnostics.message(5, CameraState.LOST, Verdict("unreliable"), now_s)
        named = {status["name"]: status for status in message["status"]}
        levels.append([named[f"kitchen: {one}"]["level"] for one in ("camera", "map", "fault dark", "fault recovered")])
        assert named["kitchen: fault dark"]["message"] == "b"
        assert named["kitchen: fault dark"]["values"] == [{"key": "count", "value": "2"}]
    assert levels == [[2, 2, 1, 0], [2, 2, 0, 0]]
