"""Where the robot's own tf has its base in odom."""

from contextlib import suppress

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import CameraError, OdometryError
from edgemap.runtime.messages.build import FrameIds
from edgemap.runtime.messages.poses import planar
from edgemap.runtime.messages.stamps import ns_of, to_s
from edgemap.runtime.messages.topics import KINDS, TF
from edgemap.runtime.ros2.growing_track import GrowingTrack
from edgemap.runtime.ros2.node import Node, Reliability


class RobotOdom:
    """odom -> base as it comes on /tf. Called with a stamp of the stream, s. offset_s: from there to ROS time."""

    def __init__(self, node: Node, frames: FrameIds) -> None:
        self.offset_s = 0.0
        self._frames, self._track = frames, GrowingTrack()
        self._tf = node.subscription(TF, KINDS[TF], Reliability.RELIABLE, depth=500)

    def __call__(self, stamp_s: float) -> SE2 | None:
        """The pose at a stamp; None where tf has none."""
        for message in self._tf.take():
            for step in message.transforms:
                if (step.header.frame_id, step.child_frame_id) == (self._frames.odom, self._frames.base):
                    moved = step.transform
                    with suppress(CameraError):  # what is no transform is none
                        pose = planar(moved.translation, moved.rotation, TF)
                        self._track.push(to_s(ns_of(step.header.stamp)), pose)
        try:
            return self._track.at(stamp_s + self.offset_s)
        except OdometryError:
            return None
