"""`--odometry tf` beside a live camera: the base's poses by a running SLAM's tf, and its corrections."""

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from edgemap.bridges.ros2.dds.node import Node, Subscription
from edgemap.bridges.ros2.dds.sources import TfTrack
from edgemap.bridges.ros2.messages.tf_chain import PATH, Corrections, NodePath, TfChain, apart, planar_of, size_of
from edgemap.bridges.ros2.recordings.reading import short
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.grid.occupancy_grid import GridRule
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.spatial_poses import attitudes_of
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.motion.given_poses import GivenPoses
from edgemap.runtime.step.pose_journal import MAXIMUM

FOLLOWED = GridRule().cell_m  # and rad; smaller corrections wait until they add up to it


@dataclass(frozen=True, slots=True, eq=False)
class LivePoses(GivenPoses):
    """Poses that come while the map is made. The trajectory has no jumps; `correction` has them."""

    mount: Mount = field(kw_only=True)
    path: "MapPath" = field(kw_only=True)

    def attitude(self, stamp_s: float) -> Attitude | None:
        """By the poses about a stamp; None where the base is level."""
        later = [row for row in self.path.tf.recent if row[0] > self.path.first[0]]
        after = bisect_left([row[0] for row in later], stamp_s)
        near = [self.path.first, *later[max(after - 1, 0) : after + 1]]
        stamps_s, poses = np.array([row[0] for row in near]), np.array([row[1] for row in near])
        track = attitudes_of(stamps_s, poses, "z", self.mount)
        return track and track.at(stamp_s, self.height_m)

    def correction(self, stamp_s: float) -> Callable[[float], SE2 | None] | None:
        """All poses so far in the map, where the map has moved against odom since."""
        return self.path.at if self.path.follow(stamp_s) else None


class MapPath:
    """Poses of the base in the map at the frames' stamps, as the corrections so far move them: those of tf, and the
    paths that the SLAM publishes. first: stamp and pose (4, 4) when the source was opened."""

    def __init__(self, node: Node, tf: TfTrack) -> None:
        self.first = tf.recent[-1]
        self._node, self.tf, self._look_timer = node, tf, StreamTimer(EVERY_S)
        self._topics: dict[str, tuple[Subscription, NodePath]] = {}
        # Stamp, path in m, pose in odom over its restarts, pose in the map: (MAXIMUM, 8).
        self._rows, self._count = np.zeros((MAXIMUM, 8)), 0
        self._map_odom, self._odom, self._restarts = SE2(), SE2(), -1
        self._corrections = Corrections()

    def follow(self, stamp_s: float) -> bool:
        """Adds the pose at a frame's stamp, where tf has one. Returns whether poses so far are others than those that
        were used."""
        try:
            odom = self.tf.at(stamp_s)
        except OdometryError:
            return False
        came, map_odom = self._take_paths(stamp_s), SE2(*planar_of(self.tf.chain.map_odom))
        restarted, self._restarts = self.tf.restarts != self._restarts, self.tf.restarts
        if restarted:
            self._map_odom = map_odom
        step, self._odom = SE2() if restarted else self._odom.inverse() @ odom, odom
        if self._count == MAXIMUM:  # the older half gets coarser, as in the journal of poses
            kept = np.delete(self._rows, slice(1, MAXIMUM // 2, 2), axis=0)
            self._rows[: len(kept)], self._count = kept, len(kept)
        last = self._rows[self._count - 1]  # zeros before the first
        path_m, total = last[1] + math.hypot(step.x_m, step.y_m), SE2(*last[2:5]) @ step
        self._rows[self._count] = stamp_s, path_m, *total.vector(), *(self._map_odom @ odom).vector()
        self._count += 1
        rows, moved = self._rows[: self._count], map_odom @ self._map_odom.inverse()
        stamps_s, odoms, poses = rows[:, 0], rows[:, 2:5], rows[:, 5:]
        jumped = size_of(moved, poses[-1]) > FOLLOWED
        changed = jumped or restarted or self._count == 2  # before the first frame the robot was elsewhere
        if jumped:
            self._corrections.spread(poses, rows[:, 1], moved, stamp_s)
            self._map_odom = map_odom
        for _, path in self._topics.values() if jumped or came else ():
            through = path.through(stamps_s, odoms, poses, self._corrections)
            if through is not None and (jumped or apart(through, poses).max() > FOLLOWED):
                poses[:], changed = through, True
        return changed

    def _take_paths(self, stamp_s: float) -> bool:
        """Whether a path came since the last frame."""
        for topic, kind in self._node.published().items() if self._look_timer.due(stamp_s) else ():
            if short(kind) == PATH and topic not in self._topics:
                self._topics[topic] = Subscription(self._node, topic, kind), NodePath(self.tf.chain.top)
        came = [(nodes, message) for messages, nodes in self._topics.values() for message in messages.take()]
        for nodes, message in came:
            nodes.take(message, self.tf.offset_s())
        return bool(came)

    def at(self, stamp_s: float) -> SE2 | None:
        """The pose at a frame's stamp."""
        row = int(np.searchsorted(self._rows[: self._count, 0], stamp_s))
        found = row < self._count and self._rows[row, 0] == stamp_s
        return SE2(*self._rows[row, 5:]) if found else None


def live_tf_poses(node: Node, where: str, offset_s: Callable[[], float]) -> Callable[[str, Mount], GivenPoses]:
    """What `CameraInfo.tf` is of a live camera: subscribes to tf. offset_s: from stamps of the stream to ROS time."""

    def poses(frames: str, mount: Mount) -> GivenPoses:
        track = TfTrack(node, TfChain(frames, where), offset_s)
        track.join()
        path = MapPath(node, track)
        start = SE2(*planar_of(path.first[1]))
        return LivePoses(track, None, mount.height_m, (), start, mount=mount, path=path)

    return poses
