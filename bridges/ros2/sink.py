"""A run's results, published live as ROS 2 topics."""

import math
import os
import time
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any

from edgemap.bridges.ros2.dds.discovery import discovery_from
from edgemap.bridges.ros2.dds.node import Node, Publisher, Reliability, Subscription, shared_node
from edgemap.bridges.ros2.dds.sources import robot_odom
from edgemap.bridges.ros2.dds.types import in_namespace
from edgemap.bridges.ros2.messages import build, topics
from edgemap.bridges.ros2.messages.definitions import RosClock
from edgemap.bridges.ros2.messages.diagnostics import RunDiagnostics, label_info
from edgemap.bridges.ros2.messages.stream import MessageStream, Outgoing
from edgemap.bridges.ros2.messages.topics import FrameIds, Topic
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError, UsageError
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.option_texts import words_of
from edgemap.runtime.frames.reading import print_message
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

GLOBAL = (topics.TF, topics.TF_STATIC, topics.DIAGNOSTICS)  # one for all robots' programs: never below a namespace
PUBLISHED = (
    *GLOBAL, topics.POSE, topics.ODOMETRY, topics.BOXES, topics.OBJECTS, topics.MARKERS, topics.GRID, topics.MAP,
    topics.FLOOR_SCAN, topics.LABELS,
)  # fmt: skip
PICTURES = (topics.PICTURES, topics.INFO)
LATCHED = (topics.TF_STATIC, topics.OBJECTS, topics.MARKERS, topics.GRID, topics.MAP, topics.LABELS)
INITIAL_POSE = "/initialpose"  # RViz's 2D Pose Estimate, as AMCL takes it
SMALLEST_SIGMAS = (0.01, 0.01, 0.005)  # m, m, rad: a covariance of zeros would be a certainty that nobody has
NAMESPACE = "edgemap"  # a robot of its own name has its own /map


@dataclass(frozen=True, slots=True)
class Ros2Options:
    """How results are published.

    namespace: prefix of every topic except tf, and except /map if the namespace is the default one. pictures: whether
    they are published too. best_effort: lost pictures, boxes and floor scans are not sent again; readers that require
    reliable ones get none. odom_tf: False where the robot publishes odom -> base itself.
    """

    namespace: str = NAMESPACE
    frames: FrameIds = field(default_factory=FrameIds)
    pictures: bool = False
    best_effort: bool = False
    odom_tf: bool = True

    @classmethod
    def of(cls, text: str) -> "Ros2Options":
        """The options in the text of `--ros2`. Raises UsageError."""
        switches = {"pictures": "no", "reliable": "yes", "odom_tf": "yes"}
        frames = [field.name for field in fields(FrameIds)]
        words = words_of(text, "--ros2", {"namespace", *switches, *frames})
        if wrong := [f"{name}={words[name]}" for name in switches if words.get(name, "yes") not in ("yes", "no")]:
            raise UsageError(f"--ros2 {wrong[0]}: expected yes or no")
        ids = FrameIds(**{name: words[name] for name in frames if name in words})
        names = [getattr(ids, name) for name in frames]
        if len(set(names)) != len(names):
            raise UsageError(f"--ros2 {text}: frames {', '.join(names)} must be different")
        pictures, reliable, odom_tf = (words.get(name, usual) == "yes" for name, usual in switches.items())
        return cls(words.get("namespace", NAMESPACE), ids, pictures, not reliable, odom_tf)

    @property
    def published(self) -> tuple[Topic, ...]:
        """The topics, without the namespace."""
        return PUBLISHED + PICTURES * self.pictures

    def topic(self, topic: str) -> str:
        """Its name with the namespace."""
        shared = (*GLOBAL, topics.MAP) if self.namespace.strip("/") == NAMESPACE else GLOBAL
        return topic if topic in shared else in_namespace(self.namespace, topic)

    def reliability(self, topic: str) -> Reliability:
        """Reliability of one topic."""
        if topic in LATCHED:
            return Reliability.LATCHED
        if self.best_effort and topic in (*PICTURES, topics.BOXES, topics.FLOOR_SCAN):
            return Reliability.BEST_EFFORT
        return Reliability.RELIABLE


class Ros2Sink(Sink):
    """Publishes every step; messages without readers are not built, except latched ones. The run's edits take the poses
    that come on /initialpose, in the map's frame."""

    name = "ROS 2"

    def __init__(self, node: Node, run: RunInfo, options: Ros2Options) -> None:
        self._options, self._run = options, run
        self._diagnostics = RunDiagnostics(options.namespace.strip("/") or NAMESPACE, run.robot)
        self._diagnosed_s = -math.inf
        odom = None if options.odom_tf else robot_odom(node, options.frames)
        lens, mount = run.floor.intrinsics, run.floor.mount
        self._stream = MessageStream(lens, mount, options.frames, static_mount=True, robot_odom=odom)
        self._publishers = {topic: self._publisher(node, topic) for topic in options.published}
        self._asked: Future[str] | None = None  # the newest pose, until it is taken or refused
        self._goals: deque[SE2] = deque(maxlen=8)
        self._goal = Publisher(node, topics.GOAL, topics.GOAL.kind)
        self._initial_pose = Subscription(node, INITIAL_POSE, topics.POSE.kind)
        by_ros = run.camera.info.name.startswith("ros2:")
        self._clock = RosClock((lambda: -run.camera.clock_offset_s) if by_ros else None)
        info = label_info(time.time_ns(), run.classes, run.threshold, options.frames.optical)
        self._publishers[topics.LABELS].write(info)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Publish one step, and apply a pose that a person has set. Raises BridgeError."""
        self._take_pose()
        while self._goals:
            self._goal.write(build.goal_pose(self._goals.popleft(), self._options.frames.map, time.time_ns()))
        self._stream.offset_s = self._clock.offset_s(result.frame.stamp_s, sum(result.stages_ms.values()) / 1e3)
        self._send(self._stream.step(result, objects))
        self._diagnostics.step(result)
        if time.monotonic() - self._diagnosed_s >= EVERY_S:  # as diagnostic_updater
            self._diagnose()
        if self._asked is not None and self._asked.done():
            asked, self._asked = self._asked, None
            if (refusal := asked.exception()) is not None:
                raise BridgeError(f"{INITIAL_POSE}: {refusal}")

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """Publish the boxes that came after the last frame, and the map. Raises BridgeError."""
        self._stream.offset_s = self._clock.offset_s(result.frame.stamp_s)
        self._send(self._stream.last(result, objects))

    def _send(self, messages: Iterable[Outgoing]) -> None:
        for outgoing in messages:
            publisher = self._publishers.get(outgoing.topic)
            if publisher is not None and publisher.wanted:
                publisher.write(outgoing.make())

    def fault(self, fault: Fault) -> None:
        """Among the diagnostics at once: while the camera is away no step brings them."""
        self._diagnostics.fault(fault, time.monotonic())
        self._diagnose()

    def _diagnose(self) -> None:
        self._diagnosed_s, publisher = time.monotonic(), self._publishers.get(topics.DIAGNOSTICS)
        if publisher is not None and publisher.wanted:
            state, verdict = self._run.camera.state, self._run.verdict()
            publisher.write(self._diagnostics.message(time.time_ns(), state, verdict, self._diagnosed_s))

    def send_goal(self, pose_map_base: SE2) -> None:
        """Publish a goal for the robot's base with the next step; from any thread."""
        self._goals.append(pose_map_base)

    def _take_pose(self) -> None:
        with suppress(BridgeError):  # a damaged message of somebody else's
            message = self._initial_pose.newest()
            if message is not None and message.header.frame_id.lstrip("/") == self._options.frames.map:
                self._asked = self._run.edits.submit(pose_edit(message))

    def close(self) -> None:
        """Unpublish and unsubscribe; may be called twice."""
        self._publishers.clear()
        self._initial_pose.close()

    def _publisher(self, node: Node, topic: Topic) -> Publisher:
        name = self._options.topic(topic)
        depth = 1 if topic in LATCHED[1:] else 100 if topic == topics.TF else 10
        return Publisher(node, name, topic.kind, self._options.reliability(topic), depth)


def pose_edit(message: Any) -> Edit:
    """The edit that a geometry_msgs/PoseWithCovarianceStamped in the map's frame is: the robot is there."""
    at, turned, covariance = message.pose.pose.position, message.pose.pose.orientation, message.pose.covariance
    yaw_rad = math.atan2(
        2.0 * (turned.w * turned.z + turned.x * turned.y), 1.0 - 2.0 * (turned.y * turned.y + turned.z * turned.z)
    )
    variances = (covariance[0], covariance[7], covariance[35])
    x_sigma, y_sigma, yaw_sigma = (
        max(math.sqrt(max(value, 0.0)), least) for value, least in zip(variances, SMALLEST_SIGMAS, strict=True)
    )
    return Edit("pose", pose=(at.x, at.y, yaw_rad), sigmas=(x_sigma, y_sigma, yaw_sigma))


def open(address: str, run: RunInfo) -> Ros2Sink:
    """The sink of `--ros2 NAME=VALUE,…`. Raises UsageError, BridgeError or MissingExtraError."""
    options, node = Ros2Options.of(address), shared_node()
    names = ", ".join(map(options.topic, options.published))
    print_message(f"ROS 2: {discovery_from(os.environ)}; topics {names}")
    return Ros2Sink(node, run, options)
