"""Attitude of each frame from the pictures alone: the odometry's tilt, in which a room's edges are a measurement."""

import math
from dataclasses import replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, RoomAxes, TrackedRotation
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.mount import Mount, up_optical
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.camera.room_edges import room_axes
from edgemap.geometry.robust import CLEAR_SIGMAS

LONGEST_S = 1.0  # between two frames of one drive
REACH_SIGMAS = 3.0  # of a carried camera, within which up is searched: at 3.29 home 9280 errs by 0.45, not 0.05 m


class PicturesAttitude:
    """Roll and pitch as the odometry last measured them.

    For a mounted camera `predict` gives the mount's angles, because the odometry starts from those. For a carried
    camera it gives the last tilt, once that is certain enough to show an error of the mount of `tilt.prior`.
    """

    name = "pictures"

    def __init__(self, mount: Mount, tilt: MountTiltRule) -> None:
        self._carried_rad, self._nodding_rad = tilt.prior, tilt.nod / 2.0
        self.correct_mount(mount)
        self._seen_s, self._carried = -math.inf, Carried()
        self._edges: tuple[Array, Array] | None = None  # of an earlier picture, in the last frame's optical axes

    def predict(self, stamp_s: float) -> Attitude:
        """The prediction before this frame is tracked: the mount's angles, or for a carried camera the tilt of the
        previous frame with a covariance that allows for its rotation since.
        """
        span_s = stamp_s - self._seen_s
        span_s, self._seen_s = span_s if 0.0 < span_s < LONGEST_S else LONGEST_S, stamp_s
        self._up_rad = math.hypot(self._up_rad, math.sqrt(self._carried.rate2) * span_s)
        return self._attitude(measured=self._carried.share > 0.0, predicted=True)

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The attitude of the last frame, as the odometry measured it."""
        if rotation is None:
            self._edges = None
        else:
            self._edges = self._edges and (self._edges[0] @ rotation.rotation, self._edges[1])
            self._carried = rotation.carried or self._carried
            self._up = rotation.rotation.T @ self._up if rotation.up is None else rotation.up
            self._up_rad = self._up_rad if rotation.up is None else rotation.up_rad
        return self._attitude(measured=True, predicted=False)

    def see_edges(self, normals: Array, lengths: Array) -> RoomAxes | None:
        """The room by the edges of the last frame's picture (as of `room_axes`) and those of the picture before it that
        was read; None where too few agree."""
        reach_rad, before = REACH_SIGMAS * self._carried_rad, self._edges
        self._edges, room = (normals, lengths), None
        if before is not None:
            both = np.concatenate([before[0], normals]), np.concatenate([before[1], lengths])
            room = room_axes(*both, self._up, reach_rad)
        if room is None:
            room = room_axes(normals, lengths, self._up, reach_rad)
        return room

    def correct_mount(self, mount: Mount) -> None:
        """The mount has these angles, at which the tilt starts again."""
        self._given = Attitude.of_mount(mount, self._nodding_rad)
        self._up, self._up_rad = up_optical(mount.pitch_rad, mount.roll_rad), math.inf

    def _attitude(self, measured: bool, predicted: bool) -> Attitude:
        """The tilt of the last frame, where it was measured and is certain enough; else the mount's angles."""
        if not measured or CLEAR_SIGMAS * self._up_rad >= self._carried_rad:
            return replace(self._given, predicted=predicted)
        return replace(Attitude.of_up(self._up, np.eye(2) * self._up_rad**2, self.name), predicted=predicted)
