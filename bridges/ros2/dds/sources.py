"""Live tf, wheel odometry and inertial samples on ROS 2 topics, beside any camera."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from edgemap.bridges.ros2.dds.node import Answer, Node, Reliability, Subscription, wait_for
from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.tf_chain import TfChain, planar_of
from edgemap.bridges.ros2.messages.tf_tree import TfTree, planar
from edgemap.bridges.ros2.messages.topics import TF, TF_STATIC, WHEEL, FrameIds
from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.trajectory import GrowingTrack

WAIT_S = 6.0  # for what somebody publishes: Fast DDS announces latched topics to late readers every 3 s
LATE_S = 0.05  # how long a step waits for the wheels' pose of its own stamp, or its picture's depth
RECENT = 50  # poses with tilt that are kept: those about a picture


class TfListener:
    """Gathers /tf_static and /tf for questions about frames that do not move against each other. where: for
    messages."""

    def __init__(self, node: Node, where: str) -> None:
        latched = Subscription(node, TF_STATIC, TF_STATIC.kind, Reliability.LATCHED, depth=100)
        self._topics = [latched, Subscription(node, TF, TF.kind, depth=100)]
        self._tree = TfTree(where)

    def ask(self, question: Callable[[TfTree], Answer | None]) -> Answer | None:
        """Waits for an answer from the tree; None where there is none in time. Raises CameraError for an invalid
        transform.
        """

        def answer() -> Answer | None:
            for topic in self._topics:
                for message in topic.take():
                    self._tree.add(message)
            return question(self._tree)

        return wait_for(answer, WAIT_S)


class TopicTrack(GrowingTrack):
    """Poses of a topic, looked up by stamps of the stream, s. offset_s: from there to ROS time. late_s: how long a pose
    is waited for. A subclass adds its messages by `push`."""

    def __init__(self, messages: Subscription, offset_s: Callable[[], float], late_s: float = LATE_S) -> None:
        super().__init__()
        self._messages, self.offset_s, self._late_s = messages, offset_s, late_s

    def at(self, stamp_s: float, tolerance_s: float = 0.0) -> SE2:
        """The pose as of a GrowingTrack, after waiting for messages."""
        for message in self._messages.take_while(lambda: not self._stamps or self._stamps[-1] < stamp_s, self._late_s):
            self._add(message)
        return super().at(stamp_s, tolerance_s)

    def _add(self, message: Any) -> None:
        raise NotImplementedError


class WheelTopic(TopicTrack):
    """nav_msgs/Odometry of the wheels."""

    def __init__(self, node: Node, topic: str, offset_s: Callable[[], float]) -> None:
        super().__init__(Subscription(node, topic, WHEEL.kind, depth=500), offset_s)
        self._name = f"ros2:{topic}"

    def __str__(self) -> str:
        return self._name

    def _add(self, message: Any) -> None:
        pose = message.pose.pose
        with suppress(CameraError):  # invalid poses are ignored
            planar_pose = planar(pose.position, pose.orientation, self._name)
            self.push(to_s(ns_of(message.header.stamp)) - self.offset_s(), planar_pose)


class TfTrack(TopicTrack):
    """Poses of the base in odom, as tf brings them. recent: stamps and poses (4, 4) in the map."""

    def __init__(self, node: Node, chain: TfChain, offset_s: Callable[[], float], late_s: float = LATE_S) -> None:
        super().__init__(Subscription(node, TF, TF.kind, Reliability.RELIABLE, depth=500), offset_s, late_s)
        self._static = Subscription(node, TF_STATIC, TF_STATIC.kind, Reliability.LATCHED, depth=100)
        self.chain, self.recent = chain, deque[tuple[float, Array]](maxlen=RECENT)

    def join(self) -> None:
        """Waits for the frames and a first pose. Raises CameraError where there is none in time."""
        for message in self._messages.take_while(lambda: not self.recent, WAIT_S):
            self._add(message)
        if not self.recent:
            raise CameraError(f"{TF}: no pose of {self.chain.base} within {WAIT_S:.0f} s")

    def _add(self, message: Any) -> None:
        for latched in self._static.take():
            self.chain.take(latched, [])
        if (taken := self.chain.take(message, [])) is not None:
            stamp_s = to_s(taken[0]) - self.offset_s()
            self.recent.append((stamp_s, self.chain.map_odom @ taken[1]))
            self.push(stamp_s, SE2(*planar_of(taken[1])))


def robot_odom(node: Node, frames: FrameIds) -> Callable[[float], SE2 | None]:
    """odom -> base as it comes on /tf, by stamp in ROS time, s; None where tf has none."""
    track = TfTrack(node, TfChain(f"{frames.odom},{frames.base}", TF), float, late_s=0.0)

    def at(stamp_s: float) -> SE2 | None:
        try:
            return track.at(stamp_s)
        except OdometryError:
            return None

    return at
