"""The base's poses by the tf of a recording: those of a SLAM that ran beside it, with its corrections."""

from contextlib import suppress

import numpy as np

from edgemap.bridges.ros2.messages.definitions import to_s
from edgemap.bridges.ros2.messages.tf_chain import PATH, SAME, Corrections, NodePath, TfChain, inverted, planar_of
from edgemap.bridges.ros2.messages.topics import TF, TF_STATIC
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import composed
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.faults import note_dropped
from edgemap.runtime.frames.reading import one_line, print_message
from edgemap.runtime.frames.spatial_poses import attitudes_of
from edgemap.runtime.frames.trajectory import EDGE_S, Trajectory
from edgemap.runtime.motion.given_poses import GivenPoses


def tf_poses(recording: Reading, frames: str, mount: Mount, first_s: float) -> GivenPoses:
    """The base's poses in the map frame at the stamps of tf. frames: `MAP,BASE`, empty for the usual names. first_s: at
    which the map begins, `GivenPoses.start`.

    A change of the transform from map to its child (odom) is a correction, by which earlier poses move too: onto the
    path that the SLAM published, where there is one. Raises CameraError where tf does not join both frames,
    OdometryError where it has no pose at the start.
    """
    chain, dropped, rows = TfChain(frames, f"{recording.path}"), list[str](), dict[int, tuple[Array, Array]]()
    for topic in (TF_STATIC, TF):
        for log_ns, message in recording.messages(topic) if topic in recording.topics else ():
            if (taken := chain.take(message, dropped, log_ns)) is not None:
                rows[taken[0]] = chain.map_odom, taken[1]
    note_dropped(f"{recording.path}: tf", dropped, len(rows) + len(dropped))
    base = chain.base
    if len(rows) < 2:
        raise CameraError(f"{recording.path}: tf has {len(rows)} poses of {one_line(base)}, need 2 or more")
    stamps_s = np.array([to_s(stamp_ns) for stamp_ns in sorted(rows)])
    map_odom, odom = map(np.array, zip(*(rows[stamp_ns] for stamp_ns in sorted(rows)), strict=True))
    poses = map_odom @ odom
    planar = _corrected(recording, chain.top, stamps_s, planar_of(map_odom), planar_of(poses))
    track = Trajectory(stamps_s, tuple(SE2(*pose) for pose in planar.tolist()))
    try:
        start = track.at(first_s, EDGE_S)
    except OdometryError as error:
        raise OdometryError(f"{recording.path}: the first picture: {error} (of tf)") from None
    return GivenPoses(track, attitudes_of(stamps_s, poses, "z", mount), mount.height_m, start=start)


def _corrected(recording: Reading, top: str, stamps_s: Array, map_odom: Array, poses: Array) -> Array:
    """The poses (N, 3) with each correction of the map-to-odom transforms (N, 3) spread over the path before it, or as
    a path of the SLAM has them."""
    jumps = np.flatnonzero((np.abs(np.diff(map_odom, axis=0)) > SAME).any(axis=1)) + 1
    odom = composed(inverted(map_odom), poses)  # in the frame that does not jump
    path_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(odom[:, :2], axis=0).T))])
    corrections = Corrections()
    for jump in jumps.tolist():
        moved = SE2(*map_odom[jump]) @ SE2(*map_odom[jump - 1]).inverse()
        corrections.spread(poses[:jump], path_m[:jump], moved, stamps_s[jump])
    for topic in recording.topics_of(PATH):
        nodes = NodePath(top)
        with suppress(CameraError):  # damaged: those before count
            for _, message in recording.messages(topic):
                nodes.take(message)
        if (moved := nodes.through(stamps_s, odom, poses, corrections)) is not None:
            print_message(f"{recording.path}: corrections of tf are spread as {topic} has them")
            return moved
    return poses
