"""What tf says of a base in a map: the frames between both, and corrections of the map, which move earlier poses."""

from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.tf_tree import transform_of
from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2, wrap_angles
from edgemap.geometry.trajectory_correction import composed
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.frames.spatial_poses import poses_of
from edgemap.runtime.frames.trajectory import QUATERNION_TOLERANCE

MAP, BASES = "map", ("base_footprint", "base_link")  # REP 105 and 120
SAME = 1e-6  # m and rad; a correction that is smaller is none
PATH = "nav_msgs/Path"
TF_AGREES = 0.1  # m, and rad: how near tf's pose the newest node is, if the nodes are poses of the base
LOGGED = 0.75  # of the largest correction: a path with such a step at its time logs tf as it was


class TfChain:
    """The newest transforms from the map to the base, as messages bring them. frames: `MAP,BASE`, empty for the usual
    names. where: for messages. A frame keeps its first parent."""

    def __init__(self, frames: str, where: str) -> None:
        names = [name.strip().lstrip("/") for name in frames.split(",")] if frames else []
        self.top, self._bases = (names[0] or MAP if names else MAP), (names[1:] or list(BASES))
        self._where = where
        self._parents, self._links = dict[str, str](), dict[str, Array]()  # by frame
        self._chain: list[str] = []  # from below the map's frame down to the base; empty until they are joined

    @property
    def base(self) -> str:
        """The base's frame. Raises CameraError where it is not joined to the map's."""
        if self._chain:
            return self._chain[-1]
        known = ", ".join(sorted({*self._parents, *self._parents.values()})[:12]) or "none"
        raise CameraError(
            f"{self._where}: tf does not join {one_line(self.top)} to {' or '.join(map(one_line, self._bases))} (its "
            f"frames: {known}); --odometry tf:MAP,BASE names others"
        )

    @property
    def map_odom(self) -> Array:
        """The transform (4, 4) from the map to the frame below it (odom); the identity where that is the base."""
        return self._links[self._chain[0]] if len(self._chain) > 1 else np.eye(4)

    def take(self, message: Any, dropped: list[str], log_ns: int = 0) -> tuple[int, Array] | None:
        """Takes a decoded `tf2_msgs/TFMessage`. Returns stamp in ns and pose (4, 4) of the base in odom, where the
        message changes that. dropped: gets why transforms are. log_ns: stamp of those that have none."""
        stamps_ns: dict[str, int] = {}
        for step in message.transforms:
            child, parent = step.child_frame_id.lstrip("/"), step.header.frame_id.lstrip("/")
            if self._parents.setdefault(child, parent) == parent and (not self._chain or child in self._chain):
                try:
                    self._links[child] = transform_of(step.transform, f"tf to {one_line(child, 60)}")
                    stamps_ns[child] = ns_of(step.header.stamp) or log_ns
                except CameraError as error:
                    dropped.append(str(error))
        self._chain = self._chain or self._joined()
        below = self._chain[1:] or self._chain
        if stamps_ns.keys().isdisjoint(below) or not self._links.keys() >= set(self._chain):
            return None
        pose = reduce(np.matmul, [self._links[child] for child in below])
        return max(stamps_ns[child] for child in below if child in stamps_ns), pose

    def _joined(self) -> list[str]:
        for base in self._bases:
            chain: list[str] = []
            while base in self._parents and base not in chain:
                chain.append(base)
                base = self._parents[base]
                if base == self.top:
                    return chain[::-1]
        return []


class Corrections:
    """Spreads each correction of the map over the path before it: as far back as the mean drift, all corrections so far
    over all path so far, makes such an error. Each step of that path turns by its share; what is then left of the error
    of the last place is spread likewise, as a pose graph of odometry does with one loop.

    largest: size in m and stamp of the largest so far."""

    def __init__(self) -> None:
        self._sum_m, self.largest = 0.0, (0.0, 0.0)

    def spread(self, poses: Array, path_m: Array, moved: SE2, stamp_s: float) -> None:
        """Moves poses (N, 3) in place, the last of them by all of a correction at a stamp. path_m: travelled up to
        each, (N,)."""
        size_m = size_of(moved, poses[-1])
        self._sum_m, self.largest = self._sum_m + size_m, max(self.largest, (size_m, stamp_s))
        first = int(np.searchsorted(path_m, path_m[-1] * (1.0 - size_m / max(self._sum_m, SAME))))
        past, since_m = poses[first:], path_m[first:] - path_m[first]
        shares = (since_m / since_m[-1] if since_m[-1] > SAME else np.ones(len(since_m)))[:, None]
        turn, end_m = np.array([0.0, 0.0, moved.yaw_rad]), moved.apply(past[-1, :2])
        half = shares - np.diff(shares, axis=0, prepend=shares[:1]) / 2.0
        steps = composed(half * turn, np.diff(past, axis=0, prepend=past[:1]))
        places_m = past[0, :2] + np.cumsum(steps[:, :2], axis=0)
        past += shares * turn
        past[:, :2] = places_m + shares * (end_m - places_m[-1])


class NodePath:
    """Nodes of a SLAM's pose graph in the map, as corrected so far: the newest path that it publishes (nav_msgs/Path).

    RTAB-Map stamps all poses of its mapPath as the message: then a node has the stamp of the last message that it
    ended. top: the map's frame.
    """

    def __init__(self, top: str) -> None:
        self._top, self._ended_ns = top, dict[int, int]()  # by number of poses
        self._stamps_s, self._poses = np.zeros(0), np.zeros((0, 3))

    def take(self, message: Any, offset_s: float = 0.0) -> None:
        """Takes a decoded message. offset_s: from the stream's stamps to the message's."""
        count = len(message.poses)
        if message.header.frame_id.lstrip("/") != self._top or not count:
            return
        self._ended_ns = {n: ns for n, ns in self._ended_ns.items() if n < count} | {count: ns_of(message.header.stamp)}
        stamps = [ns_of(node.header.stamp) for node in message.poses]
        if len(set(stamps)) == 1:
            stamps = [self._ended_ns.get(n + 1, 0) for n in range(count)]
        parts = [(node.pose.position, node.pose.orientation) for node in message.poses]
        rows = np.array([[at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w] for at, turn in parts])
        good = (np.diff(np.maximum.accumulate(stamps), prepend=0) > 0) & np.isfinite(rows).all(axis=1)
        good &= np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1.0) < QUATERNION_TOLERANCE
        self._stamps_s = np.array([to_s(ns) - offset_s for ns in np.array(stamps)[good].tolist()])
        self._poses = planar_of(poses_of(rows[good, :3], rows[good, 3:]))

    def through(self, stamps_s: Array, odom: Array, poses: Array, corrections: Corrections) -> Array | None:
        """The poses (N, 3) at stamps (N,), moved: odometry's (N, 3) through first, nodes and last. None where the nodes
        are poses of another frame, or a log of tf. corrections: those that the poses have."""
        inside = (self._stamps_s >= stamps_s[0]) & (self._stamps_s < stamps_s[-1])
        nodes_s, nodes = self._stamps_s[inside], self._poses[inside]
        largest_m, largest_s = corrections.largest
        if len(nodes) < 2 or not largest_m:
            return None
        after, share = _between_stamps(stamps_s, nodes_s)
        at_nodes, by_tf = (_between(rows[after - 1], rows[after], share) for rows in (odom, poses))
        joined = composed(nodes, inverted(at_nodes))  # the map to odom
        at = int(np.clip(np.searchsorted(nodes_s, largest_s), 1, len(nodes) - 1))
        ends = np.array([by_tf[-1], composed(joined[[at - 1]], at_nodes[[at]])[0]])
        apart_m, step_m = apart(ends, nodes[[-1, at]]).tolist()
        if apart_m > TF_AGREES or step_m > LOGGED * largest_m:
            return None
        first, last = composed(poses[[0, -1]], inverted(odom[[0, -1]]))
        joined, joined_s = np.array([first, *joined, last]), np.array([stamps_s[0], *nodes_s, stamps_s[-1]])
        after, share = _between_stamps(joined_s, stamps_s)
        return _between(composed(joined[after - 1], odom), composed(joined[after], odom), share)


def _between_stamps(stamps_s: Array, at_s: Array) -> tuple[NDArray[np.intp], Array]:
    """Index (N,) of the stamp after each time among stamps (K,), and the share of the way to it from the one before."""
    after = np.minimum(np.searchsorted(stamps_s, at_s, side="right"), len(stamps_s) - 1)
    return after, (at_s - stamps_s[after - 1]) / (stamps_s[after] - stamps_s[after - 1])


def _between(before: Array, after: Array, share: Array) -> Array:
    """Poses (N, 3) at a share (N,) of the motion from those before to those after."""
    return before + share[:, None] * _difference(before, after)


def _difference(one: Array, other: Array) -> Array:
    """Of poses (N, 3), by the shorter turn."""
    difference = other - one
    difference[:, 2] = wrap_angles(difference[:, 2])
    return difference


def planar_of(poses: Array) -> Array:
    """Poses (…, 4, 4) on the floor, x, y, yaw, (…, 3)."""
    return np.stack([poses[..., 0, 3], poses[..., 1, 3], np.arctan2(poses[..., 1, 0], poses[..., 0, 0])], axis=-1)


def inverted(poses: Array) -> Array:
    """`SE2.inverse` of rows (N, 3)."""
    return composed(poses * [0.0, 0.0, -1.0], poses * [-1.0, -1.0, 0.0])


def size_of(moved: SE2, pose: Array) -> float:
    """How far a correction moves a robot at a pose (3,), a radian counting as a metre."""
    return float(np.hypot(*(moved.apply(pose[:2]) - pose[:2])) + abs(moved.yaw_rad))


def apart(one: Array, other: Array) -> Array:
    """How far poses (N, 3) are apart, (N,), a radian counting as a metre."""
    x_m, y_m, turn = _difference(one, other).T
    return np.hypot(x_m, y_m) + np.abs(turn)
