"""Tracked corners as a member of the hybrid: landmarks of a robot; the window of keyframes of a carried camera, or with
depth."""

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.depth_points import NEAREST_M
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.planar import PlanarOdometry
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion
from edgemap.runtime.motion.odometry.window import WindowOdometry
from edgemap.runtime.network.network import Tensors


class TrackedOdometry:
    """Uses the window where this frame or the last one has depth, and for a carried camera until it proves to be on
    wheels; else planar odometry.

    carried: whether it counts as carried from the start.
    """

    name, needs_features = "planar", False

    def __init__(self, planar: PlanarOdometry, window: WindowOdometry, carried: bool = False) -> None:
        self._planar, self._window = planar, window
        self._now = window if carried else planar
        self.carried, self._deep = carried, False

    @property
    def windowed(self) -> bool:
        """Whether the window is in use."""
        return self._now is self._window

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """The motion since the last frame, by the one that is in use. The other one may start with this frame."""
        motion = self._now.step(frame, features, prior)
        judged = self._now.judged
        self.carried = judged.carried or (self.carried and not judged.on_wheels)
        was_deep, self._deep = self._deep, frame.depth is not None and bool(np.any(frame.depth > NEAREST_M))
        wanted = self._window if self.carried or self._deep or was_deep else self._planar
        if wanted is not self._now:
            self._now = wanted
            self._now.judged = judged
            self._now.reset("begun")
            self._now.step(frame, features, prior)
        return motion

    def sways(self, nod2: float, motion: SE2, span_s: float, gyro: bool, attitude: Attitude | None = None) -> Carried:
        """As of the one that is in use."""
        return self._now.sways(nod2, motion, span_s, gyro, attitude)

    def step_blind(self, stamp_s: float, reason: Fault, attitude: Attitude | None = None) -> Motion:
        """As of the one that is in use."""
        return self._now.step_blind(stamp_s, reason, attitude)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:
        """None: pictures alone show whether the robot stands."""
        return self._now.still(stamp_s, attitude)

    def rest(self, stamp_s: float) -> Motion:
        """As of the one that is in use."""
        return self._now.rest(stamp_s)

    def reset(self, reason: str) -> None:
        """Start again at the next frame."""
        self._now.reset(reason)
