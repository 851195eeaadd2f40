"""The base's poses by the tf of a recording: those of a SLAM that ran beside it, with its corrections."""

from collections import defaultdict
from contextlib import suppress

import numpy as np

from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.tf_chain import PATH, SAME, Corrections, NodePath, TfFrames, planar_of
from edgemap.bridges.ros2.messages.topics import TF, TF_STATIC
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.faults import note_dropped
from edgemap.runtime.frames.reading import one_line, print_message
from edgemap.runtime.frames.spatial_poses import attitudes_of, poses_of
from edgemap.runtime.frames.trajectory import EDGE_S, QUATERNION_TOLERANCE, Trajectory
from edgemap.runtime.motion.given_poses import GivenPoses


def tf_poses(recording: Reading, frames: str, mount: Mount, first_s: float) -> GivenPoses:
    """The base's poses in the map frame at the stamps of tf. frames: `MAP,BASE`, empty for the usual names. first_s: at
    which the map begins, `GivenPoses.start`.

    A change of the transform from map to its child (odom) is a correction, by which earlier poses move too: onto the
    path that the SLAM published, where there is one. Raises CameraError where tf does not join both frames,
    OdometryError where it has no pose at the start.
    """
    steps = _steps(recording)
    parents = {child: parent for child, (parent, *_) in steps.items()}
    named = TfFrames(frames, f"{recording.path}")
    chain = named.chain(parents)
    moving = max(chain[1:] or chain, key=lambda child: len(steps[child][1]))
    stamps_ns = steps[moving][1]
    stamps_ns = stamps_ns[stamps_ns >= max(steps[child][1][0] for child in chain)]
    poses = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    held = {c: np.searchsorted(steps[c][1], stamps_ns, side="right") - 1 for c in chain}
    for child in chain:
        poses = poses @ steps[child][2][held[child]]
    if len(stamps_ns) < 2:
        raise CameraError(f"{recording.path}: tf has {len(stamps_ns)} poses of {one_line(chain[-1])}, need 2 or more")
    stamps_s = np.array([to_s(int(stamp)) for stamp in stamps_ns])
    if len(chain) > 1:
        poses = _corrected(recording, named.top, stamps_s, poses, steps[chain[0]][2][held[chain[0]]])
    track = Trajectory(stamps_s, tuple(map(planar_of, poses)))
    try:
        start = track.at(first_s, EDGE_S)
    except OdometryError as error:
        raise OdometryError(f"{recording.path}: the first picture: {error} (of tf)") from None
    return GivenPoses(track, attitudes_of(stamps_s, poses, "z", mount), mount.height_m, start=start)


def _steps(recording: Reading) -> dict[str, tuple[str, Array, Array]]:
    """By child frame: its parent, stamps in ns (N,) in order, and transforms (N, 4, 4)."""
    rows: dict[str, dict[int, list[float]]] = defaultdict(dict)
    parents: dict[str, str] = {}
    for topic in (TF_STATIC, TF):
        for log_ns, decode in recording.messages(topic) if topic in recording.topics else ():
            for step in decode().transforms:
                child, parent = step.child_frame_id.lstrip("/"), step.header.frame_id.lstrip("/")
                place, turn = step.transform.translation, step.transform.rotation
                stamp_ns = 0 if topic == TF_STATIC else ns_of(step.header.stamp) or log_ns
                if parents.setdefault(child, parent) == parent:
                    rows[child][stamp_ns] = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
    found = {}
    for child, by_stamp in rows.items():
        stamps = np.array(sorted(by_stamp))
        values = np.array([by_stamp[stamp] for stamp in stamps.tolist()])
        length = np.linalg.norm(np.nan_to_num(values[:, 3:], posinf=0.0, neginf=0.0), axis=1)
        good = np.asarray(np.isfinite(values).all(axis=1) & (np.abs(length - 1.0) < QUATERNION_TOLERANCE))
        if not good.all():
            note_dropped(f"{recording.path}: tf to {one_line(child)}", ["no transform"] * int((~good).sum()), len(good))
        if good.any():
            found[child] = parents[child], stamps[good], poses_of(values[good, :3], values[good, 3:])
    return found


def _corrected(recording: Reading, top: str, stamps_s: Array, poses: Array, map_odom: Array) -> Array:
    """The poses (N, 4, 4) with each correction of the map-to-odom transforms (N, 4, 4) spread over the path before it,
    or as a path of the SLAM has them."""
    jumps = np.flatnonzero((np.abs(np.diff(map_odom, axis=0)) > SAME).any(axis=(1, 2))) + 1
    odom = np.linalg.inv(map_odom) @ poses  # in the frame that does not jump
    path_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(odom[:, :3, 3], axis=0), axis=1))])
    corrections = Corrections()
    for jump in jumps.tolist():
        moved = map_odom[jump] @ np.linalg.inv(map_odom[jump - 1])
        corrections.spread(poses[:jump], path_m[:jump], moved, stamps_s[jump])
    for topic in recording.topics_of(PATH):
        nodes = NodePath(top)
        with suppress(CameraError):  # damaged: those before count
            for _, decode in recording.messages(topic):
                nodes.take(decode())
        if (moved := nodes.through(stamps_s, odom, poses, corrections)) is not None:
            print_message(f"{recording.path}: corrections of tf are spread as {topic} has them")
            return moved
    return poses
