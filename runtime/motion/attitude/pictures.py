"""Attitude of each frame from the pictures alone: the rotation that tracked corners show, and a room's edges."""

import math
from dataclasses import replace

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

Array = NDArray[np.float64]

LONGEST_S = 1.0  # between two frames of one drive
ROTATION_SHARE = 0.1  # the default of `AttitudeRule.rotation_share`
NOD_S = 1.0 / math.tau  # swing of a nod against its rate, at 1 Hz
REACH_SIGMAS = 3.0  # of a carried camera, within which up is searched: at 3.29 home 9280 errs by 0.45, not 0.05 m


class PicturesAttitude:
    """Roll and pitch by the camera's rotation from picture to picture and a room's edges, about the mount.

    The weight of the mount falls with the camera's rate of nodding. For a mounted camera `predict` gives the mount's
    angles: the odometry estimates its nods itself, starting from those. A carried camera has them too, until edges or
    depth show its tilt so well that the mount's error is clear.
    tilt: a carried camera is about the mount's angles to `tilt.prior`, a robot's to half of `tilt.nod`. rotation_share:
    as of `AttitudeRule`.
    """

    name = "pictures"

    def __init__(self, mount: Mount, tilt: MountTiltRule | None = None, rotation_share: float = ROTATION_SHARE) -> None:
        tilt = tilt or MountTiltRule()
        self._carried_rad, self._nodding_rad, self._rotation_share = tilt.prior, tilt.nod / 2.0, rotation_share
        self.correct_mount(mount)
        self.reset()

    def predict(self, stamp_s: float) -> Attitude:
        """The prediction before this frame's rotation is measured: the mount's angles, or for a carried camera the
        previous frame's attitude with a covariance that allows for its rotation since.
        """
        span_s = stamp_s - self._seen_s
        self._span_s, self._seen_s = span_s if 0.0 < span_s < LONGEST_S else LONGEST_S, stamp_s
        if self._carried.share == 0.0 or not self._converged():
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
            frames = max(2.0 * NOD_S / self._span_s, 1.0)  # whose nods are alike
            sigma_rad = (self._nodding_rad + carried_rad) * math.sqrt(frames) / (1.0 - share)
            tilt = tilt.corrected(self._mounted, sigma_rad)
        self._tilt = tilt
        if not self._converged():
            return replace(self._given, predicted=False)
        return Attitude.of_up(tilt.up, tilt.angles_covariance(), self.name)

    def reset(self) -> None:
        """Start again at the mount."""
        self._tilt = Tilt.about(self._mounted, self._nodding_rad)
        self._seen_s, self._span_s = -math.inf, LONGEST_S
        self._assumed_rad, self._begun, self._carried = 0.0, False, Carried()
        self._since: Array | None = None  # rotation since the picture whose edges are looked for
        self._before: tuple[Array, Array] | None = None  # the last edges, normals and lengths, in its axes

    def begin_edges(self) -> None:
        """Starts the edge detection on this frame's picture."""
        self._begun = True

    def see_edges(self, normals: Array, lengths: Array) -> RoomAxes | None:
        """The room in the picture that was begun, by its edges (as of `room_axes`) and those of the pictures before it;
        None where too few agree."""
        since = None if self._begun else self._since  # begun still: no rotation was measured since
        expected = self._tilt.up if since is None else since @ self._tilt.up
        reach_rad, before = REACH_SIGMAS * self._carried_rad, self._before
        self._before = None if since is None else (normals, lengths)
        room = None
        if before is not None:
            both = np.concatenate([before[0], normals]), np.concatenate([before[1], lengths])
            room = room_axes(*both, expected, reach_rad)
        pictures = 1 if room is None else 2
        if room is None:
            room = room_axes(normals, lengths, expected, reach_rad)
        if room is not None and since is not None:
            sigma_rad = room.up_sigma_rad * (1.0 + 1.0 / pictures)  # one may agree on a wrong direction
            self._tilt = self._tilt.corrected(since.T @ room.up, sigma_rad, CLEAR_SIGMAS)
        return room

    def see_up(self, up: Array, sigma_rad: float) -> None:
        """Updates with the up direction of the last frame from another source, (3,), optical axes."""
        self._tilt = self._tilt.corrected(up, sigma_rad)

    def correct_mount(self, mount: Mount) -> None:
        """The mount has these angles."""
        self._mounted = up_optical(mount.pitch_rad, mount.roll_rad)
        self._given = replace(Attitude.of_mount(mount, self._nodding_rad), predicted=True)
        self._tilt = Tilt.about(self._mounted, self._nodding_rad)

    def _converged(self) -> bool:
        """Whether this tilt is certain enough to show an error of the mount of `tilt.prior`."""
        return CLEAR_SIGMAS * self._tilt.sigma_rad() < self._carried_rad

    def _unseen(self) -> Tilt:
        """The tilt before the rotation of this frame is measured."""
        return self._tilt.widened(math.sqrt(self._carried.rate2) * self._span_s)

    def _turned(self, rotation: TrackedRotation) -> Tilt:
        """The tilt after a rotation."""
        sigma_rad = self._rotation_share * rotation_angle(rotation.rotation)
        self._carried = rotation.carried or self._carried
        return self._tilt.rotated(replace(rotation, sigma_rad=math.hypot(rotation.sigma_rad, sigma_rad)))

    def _carry_edges(self, rotation: TrackedRotation | None) -> None:
        """Rotates the kept edges into the axes of the picture that was begun."""
        if rotation is None:
            self._since = self._before = None
        elif self._since is not None:
            self._since = self._since @ rotation.rotation
        if self._begun:
            if self._before is not None and self._since is not None:
                self._before = self._before[0] @ self._since, self._before[1]
            self._since, self._begun = np.eye(3), False
