"""`--odometry tf` beside a live camera: the base's poses by a running SLAM's tf, and its corrections."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from edgemap.bridges.ros2.dds.node import Node, Subscription
from edgemap.bridges.ros2.dds.sources import TfTrack
from edgemap.bridges.ros2.messages.tf_chain import PATH, Corrections, NodePath, TfChain, apart, planar_of, size_of
from edgemap.bridges.ros2.recordings.reading import short
from edgemap.geometry.arrays import Array
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

    tf: TfTrack = field(kw_only=True)
    mount: Mount = field(kw_only=True)
    path: "MapPath" = field(kw_only=True)

    def attitude(self, stamp_s: float) -> Attitude | None:
        """By the poses about a stamp; None where the base is level."""
        later = [row for row in self.tf.recent if row[0] > self.path.first[0]]
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
        self._node, self._tf, self._look_timer = node, tf, StreamTimer(EVERY_S)
        self._topics: dict[str, tuple[Subscription, NodePath]] = {}
        self._stamps_s, self._path_m = list[float](), list[float]()
        self._poses, self._odoms = list[Array](), list[Array]()  # in the map; in odom, over its restarts
        self._map_odom, self._restarts = np.eye(4), -1
        self._odom: SE2 | None = None
        self._corrections = Corrections()

    def follow(self, stamp_s: float) -> bool:
        """Adds the pose at a frame's stamp, where tf has one. Returns whether poses so far are others than those that
        were used."""
        try:
            odom = self._tf.at(stamp_s)
        except OdometryError:
            return False
        came, map_odom = self._take_paths(stamp_s), self._tf.chain.map_odom
        restarted, self._restarts = self._tf.restarts != self._restarts, self._tf.restarts
        if restarted:
            self._map_odom = map_odom
        step = SE2() if self._odom is None or restarted else self._odom.inverse() @ odom
        self._odom = odom
        self._stamps_s.append(stamp_s)
        self._poses.append(self._map_odom @ matrix_of_pose(odom))
        self._odoms.append((self._odoms[-1] if self._odoms else np.eye(4)) @ matrix_of_pose(step))
        self._path_m.append((self._path_m[-1] if self._path_m else 0.0) + float(np.hypot(step.x_m, step.y_m)))
        if len(self._poses) > MAXIMUM:  # the older half gets coarser, as in the journal of poses
            for rows in (self._stamps_s, self._poses, self._odoms, self._path_m):
                del rows[1 : MAXIMUM // 2 : 2]
        moved = map_odom @ np.linalg.inv(self._map_odom)
        jumped = size_of(moved, self._poses[-1]) > FOLLOWED
        changed = jumped or restarted or len(self._poses) == 2  # before the first frame the robot was elsewhere
        if jumped or came:
            poses = np.array(self._poses)
            if jumped:
                self._corrections.spread(poses, np.array(self._path_m), moved, stamp_s)
                self._map_odom = map_odom
            for _, path in self._topics.values():
                through = path.through(np.array(self._stamps_s), np.array(self._odoms), poses, self._corrections)
                if through is not None and (jumped or apart(through, poses).max() > FOLLOWED):
                    poses, changed = through, True
            self._poses = list(poses)
        return changed

    def _take_paths(self, stamp_s: float) -> bool:
        """Whether a path came since the last frame."""
        for topic, kind in self._node.published().items() if self._look_timer.due(stamp_s) else ():
            if short(kind) == PATH and topic not in self._topics:
                self._topics[topic] = self._node.subscription(topic, kind), NodePath(self._tf.chain.top)
        came = [(nodes, message) for messages, nodes in self._topics.values() for message in messages.take()]
        for nodes, message in came:
            nodes.take(message, self._tf.offset_s())
        return bool(came)

    def at(self, stamp_s: float) -> SE2 | None:
        """The pose at a frame's stamp."""
        row = bisect_left(self._stamps_s, stamp_s)
        found = row < len(self._stamps_s) and self._stamps_s[row] == stamp_s
        return planar_of(self._poses[row]) if found else None


def live_tf_poses(node: Node, where: str, offset_s: Callable[[], float]) -> Callable[[str, Mount], GivenPoses]:
    """What `CameraInfo.tf` is of a live camera: subscribes to tf. offset_s: from stamps of the stream to ROS time."""

    def poses(frames: str, mount: Mount) -> GivenPoses:
        track = TfTrack(node, TfChain(frames, where), offset_s)
        track.join()
        path = MapPath(node, track)
        start = planar_of(path.first[1])
        return LivePoses(track, None, mount.height_m, (), start, tf=track, mount=mount, path=path)

    return poses


def matrix_of_pose(pose: SE2) -> Array:
    """A planar pose as (4, 4)."""
    matrix = np.eye(4)
    matrix[np.ix_([0, 1, 3], [0, 1, 3])] = pose.matrix()
    return matrix
