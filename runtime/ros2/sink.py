"""A run's results, published live as ROS 2 topics."""

import time
from dataclasses import dataclass, field

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.messages import topics
from edgemap.runtime.messages.build import FrameIds
from edgemap.runtime.messages.stamps import to_ns
from edgemap.runtime.messages.stream import MessageStream, Outgoing
from edgemap.runtime.ros2.growing_track import ros_offset_s
from edgemap.runtime.ros2.node import Node, Publisher, Reliability
from edgemap.runtime.ros2.tf import RobotOdom
from edgemap.runtime.ros2.types import in_namespace
from edgemap.runtime.slam import StepResult

GLOBAL = (topics.TF, topics.TF_STATIC)  # one tree for all robots' programs: never below a namespace
PUBLISHED = (*GLOBAL, topics.POSE, topics.ODOMETRY, topics.BOXES, topics.OBJECTS, topics.MARKERS, topics.GRID)
PICTURES = (topics.PICTURES, topics.INFO)
LATCHED = (topics.TF_STATIC, topics.OBJECTS, topics.MARKERS, topics.GRID)
DEPTHS = {topics.TF: 100, topics.PICTURES: 5, topics.INFO: 5, topics.OBJECTS: 1, topics.MARKERS: 1, topics.GRID: 1}


@dataclass(frozen=True, slots=True)
class Ros2Options:
    """How results are published.

    namespace: before every topic but tf. pictures: whether they are published too. best_effort: pictures and boxes are
    not sent again where lost; readers that ask for reliable ones then get none. odom_tf: False where the robot
    publishes odom -> base itself.
    """

    namespace: str = "edgemap"
    frames: FrameIds = field(default_factory=FrameIds)
    pictures: bool = False
    best_effort: bool = False
    odom_tf: bool = True

    def reliability(self, topic: str) -> Reliability:
        """Of one topic."""
        if topic in LATCHED:
            return Reliability.LATCHED
        if self.best_effort and topic in (*PICTURES, topics.BOXES):
            return Reliability.BEST_EFFORT
        return Reliability.RELIABLE


class Ros2Sink:
    """Publishes every step; what nobody reads is not even built, but for what later readers get. ros_time: the stamps
    are ROS time as they are."""

    name = "ROS 2"

    def __init__(self, node: Node, camera: FloorCamera, options: Ros2Options, ros_time: bool = False) -> None:
        self._options = options
        self._robot_odom = None if options.odom_tf else RobotOdom(node, options.frames)
        self._stream = MessageStream(
            camera.intrinsics, camera.mount, options.frames, static_mount=True, robot_odom=self._robot_odom
        )
        self._publishers = {topic: self._publisher(node, topic) for topic in PUBLISHED + PICTURES * options.pictures}
        self._offset_s: float | None = 0.0 if ros_time else None

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Publish one step. Raises Ros2Error."""
        if self._offset_s is None:
            age_s = sum(result.stages_ms.values()) / 1e3
            stamp_s = result.frame.stamp_s
            self._offset_s = ros_offset_s(stamp_s, time.time() - age_s, time.monotonic() - age_s)
            if self._robot_odom is not None:
                self._robot_odom.offset_s = self._offset_s
        stamp_ns = to_ns(result.frame.stamp_s + self._offset_s)
        for outgoing in self._stream.picture(result.frame, stamp_ns):
            self._send(outgoing)
        for outgoing in self._stream.results(result, objects, stamp_ns):
            self._send(outgoing)

    def fault(self, text: str) -> None:
        """Faults stand in run.json."""

    def close(self) -> None:
        """Unpublish; may be called twice."""
        self._publishers.clear()

    def _send(self, outgoing: Outgoing) -> None:
        publisher = self._publishers.get(outgoing.topic)
        if publisher is not None and publisher.wanted:
            publisher.write(outgoing.make())

    def _publisher(self, node: Node, topic: str) -> Publisher:
        name = topic if topic in GLOBAL else in_namespace(self._options.namespace, topic)
        return node.publisher(name, topics.KINDS[topic], self._options.reliability(topic), DEPTHS.get(topic, 10))
