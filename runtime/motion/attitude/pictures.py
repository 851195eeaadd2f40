"""Attitude of each frame from the pictures alone: the rotation that tracked corners show, and a room's edges."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation, rotation_angle
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.camera.room_edges import RoomAxes, room_axes
from edgemap.geometry.camera.tilt import Tilt
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.protocol import Moved
from edgemap.runtime.motion.attitude.sources import NODDING_RAD

Array = NDArray[np.float64]

LONGEST_S = 1.0  # between two frames of one drive
REACH_SIGMAS = 3.0  # of a carried camera, within which up is searched: at 3.29 home 9280 errs by 0.45, not 0.05 m


@dataclass(frozen=True, slots=True)
class PicturesRule:
    """Weights of the rotation between pictures, the room's edges and the mount. nodding_rad, nodding_s: of a level
    robot about its mount, and for how long it stays so. likely: standard deviations of nodding, at which the mount's
    weight is halved. rotation_rad, rotation_share: standard deviation of the rotation between two pictures beside what
    the corners say, and relative to it. pictures: whose edges are put together. known_rad: standard deviation beyond
    which the mount's angles are used, until the edges have been measured.
    """

    nodding_rad: float = NODDING_RAD
    nodding_s: float = 0.15
    likely: float = 10.0
    rotation_rad: float = math.radians(0.05)
    rotation_share: float = 0.1
    pictures: int = 2
    known_rad: float = math.radians(2.5)


class PicturesAttitude:
    """Roll and pitch by the camera's rotation from picture to picture and a room's edges, about the mount.

    The weight of the mount falls with the camera's rate of nodding and its distance from the mount's angles. For a
    mounted camera `predict` gives the mount's angles: the odometry estimates its nods itself, starting from those.
    tilt: a carried camera is about the mount's angles to `tilt.given`.
    """

    name = "pictures"

    def __init__(self, mount: Mount, rule: PicturesRule | None = None, tilt: MountTiltRule | None = None) -> None:
        self._rule, self._carried_rad = rule or PicturesRule(), (tilt or MountTiltRule()).given
        self.correct_mount(mount)
        self.reset("start")

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """The prediction before this frame's rotation is measured: the mount's angles, or for a carried camera the
        previous frame's attitude with a covariance that allows for its rotation since.
        """
        span_s = frame.stamp_s - self._seen_s
        self._span_s, self._seen_s = span_s if 0.0 < span_s < LONGEST_S else LONGEST_S, frame.stamp_s
        if self._carried.share == 0.0 or not self._known():
            return self._given
        ahead = self._unseen()
        return replace(Attitude.of_up(ahead.up, ahead.angles_covariance(), self.name), predicted=True)

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The attitude of the last frame, by the rotation up to it."""
        tilt = self._unseen() if rotation is None else self._turned(rotation)
        self._carry_edges(rotation)
        share = self._carried.share
        carried_rad = share * self._carried_rad
        if carried_rad > self._assumed_rad:  # the mount's tilt so far was too much
            tilt = tilt.widened(math.sqrt(carried_rad**2 - self._assumed_rad**2))
            self._assumed_rad = carried_rad
        if share < 1.0:  # what is carried keeps its tilt about the mount, which gave it once
            frames = max(2.0 * self._rule.nodding_s / self._span_s, 1.0)  # that tell the same
            sigma_rad = (self._nodding_rad(tilt) + carried_rad) * math.sqrt(frames) / (1.0 - share)
            tilt = tilt.corrected(self._mounted, sigma_rad)
        self._tilt = tilt
        if not self._known():
            return replace(self._given, predicted=False)
        return Attitude.of_up(tilt.up, tilt.angles_covariance(), self.name)

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the mount."""
        self._tilt = Tilt.about(self._mounted, self._rule.nodding_rad)
        self._seen_s, self._span_s = -math.inf, LONGEST_S
        self._assumed_rad, self._begun, self._carried = 0.0, False, Carried()
        self._since: Array | None = None  # rotation since the picture whose edges are looked for
        self._edges: list[tuple[Array, Array]] = []  # normals and lengths, in the axes of that picture

    def begin_edges(self) -> None:
        """Starts the edge detection on this frame's picture."""
        self._begun = True

    def see_edges(self, normals: Array, lengths: Array) -> RoomAxes | None:
        """The room in the picture that was begun, by its edges (as of `room_axes`) and those of the pictures before it;
        None where too few agree."""
        rule, since = self._rule, None if self._begun else self._since  # begun still: no rotation was measured since
        expected = self._tilt.up if since is None else since @ self._tilt.up
        self._edges = [*self._edges[len(self._edges) + 1 - rule.pictures :], (normals, lengths)]
        all_normals, all_lengths = (np.concatenate([edges[part] for edges in self._edges]) for part in (0, 1))
        reach_rad = REACH_SIGMAS * self._carried_rad
        room = room_axes(all_normals, all_lengths, expected, reach_rad)
        if room is None and len(self._edges) > 1:
            self._edges = [(normals, lengths)]
            room = room_axes(normals, lengths, expected, reach_rad)
        if since is None:
            self._edges = []
        elif room is not None:
            sigma_rad = room.up_sigma_rad * (1.0 + 1.0 / len(self._edges))  # one may agree on a wrong direction
            self._tilt = self._tilt.corrected(since.T @ room.up, sigma_rad, CLEAR_SIGMAS)
        return room

    def see_up(self, up: Array, sigma_rad: float) -> None:
        """Updates with the up direction of the last frame from another source, (3,), optical axes."""
        self._tilt = self._tilt.corrected(up, sigma_rad)

    def correct_mount(self, mount: Mount) -> None:
        """The mount has these angles."""
        self._mounted = up_optical(mount.pitch_rad, mount.roll_rad)
        self._given = replace(Attitude.of_mount(mount, self._rule.nodding_rad), predicted=True)
        self._tilt = Tilt.about(self._mounted, self._rule.nodding_rad)

    def _known(self) -> bool:
        """Whether this is more precise than the mount's angles."""
        return self._tilt.sigma_rad() < self._rule.known_rad

    def _unseen(self) -> Tilt:
        """The tilt before the rotation of this frame is seen."""
        return self._tilt.widened(math.sqrt(self._carried.rate2) * self._span_s)

    def _turned(self, rotation: TrackedRotation) -> Tilt:
        """The tilt after a rotation."""
        rule = self._rule
        sigma_rad = rule.rotation_rad + rule.rotation_share * rotation_angle(rotation.rotation)
        self._carried = rotation.carried or self._carried
        return self._tilt.rotated(replace(rotation, sigma_rad=math.hypot(rotation.sigma_rad, sigma_rad)))

    def _carry_edges(self, rotation: TrackedRotation | None) -> None:
        """Take the edges that are kept on to the picture that was begun."""
        if rotation is None:
            self._since, self._edges = None, []
        elif self._since is not None:
            self._since = self._since @ rotation.rotation
        if self._begun:
            since = np.eye(3) if self._since is None else self._since
            self._edges = [(normals @ since, lengths) for normals, lengths in self._edges]
            self._since, self._begun = np.eye(3), False

    def _nodding_rad(self, tilt: Tilt) -> float:
        """Standard deviation of the tilt about the mount of a robot whose camera is so far off."""
        rule, off = self._rule, tilt.up - self._mounted
        return rule.nodding_rad * (1.0 + float(off @ off) / 2.0 / (rule.likely * rule.nodding_rad) ** 2)
