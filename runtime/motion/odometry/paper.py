"""The paper's learned odometry: a network run step by step, with its recurrent state as input and output."""

import math

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.protocol import (
    NO_PRIOR,
    FramePrior,
    Motion,
    Odometry,
    blind_motion,
    first_motion,
    no_motion,
)
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.network import Tensors


class PaperOdometry(Odometry):
    """The bundle's head of kind `paper`. Raises OdometryError where the bundle has none, or an untrained one."""

    name, needs_features = "paper", True

    def __init__(self, bundle: Bundle, coasting: CoastingRule | None = None) -> None:
        self._head, self._network = bundle.odometry_head("paper")
        if not self._head.trained:
            raise OdometryError(
                f"the paper odometry of bundle {bundle.manifest.name} is untrained: its motion is noise "
                "(edgemap train odometry)"
            )
        sigmas = (self._head.sigma_forward_m, self._head.sigma_left_m, self._head.sigma_yaw_rad)
        self._covariance = np.diag(np.square(sigmas))
        self._coasting, self._last_s, self._fed = Coasting(coasting), -math.inf, 0
        self._states: Tensors = {}
        self._last: NDArray[np.float32] | None = None  # the last picture's features
        self._guessed, self._blind_covariance = SE2(), np.zeros((3, 3))  # since the last picture

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """Feed this frame's features; the first ones give identity."""
        gap_s, self._last_s = frame.stamp_s - self._last_s, frame.stamp_s
        guessed, self._guessed = self._guessed, SE2()
        blind, self._blind_covariance = self._blind_covariance, np.zeros((3, 3))
        fresh = self._last is None or gap_s > LONGEST_DT_S
        if fresh or 0 < self._head.window < self._fed:
            self._states = {state.input: np.full(state.shape, state.initial, np.float32) for state in self._head.states}
            self._fed = 0
            if self._last is not None and not fresh:
                self._feed(self._last)
        motion, self._last = self._feed(features[self._head.feature]), features[self._head.feature]
        if fresh and math.isfinite(gap_s):
            text = f"paper odometry: {gap_s:.3f} s since the last frame, started again"
            return blind_motion(Fault(FaultKind.ODOMETRY, text))
        if fresh:
            self._coasting.begin(frame.stamp_s)
            return first_motion()
        if not np.isfinite(motion.vector()).all():
            self._last = None
            text = f"paper odometry: motion not finite at frame {frame.index}, state reset"
            return blind_motion(Fault(FaultKind.OUT_OF_RANGE, text))
        motion = guessed.inverse() @ motion
        self._coasting.saw(motion, frame.stamp_s, self._covariance)
        return Motion(motion, self._covariance + blind)

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """A guess; the next picture measures the motion since the last one."""
        guess = self._coasting.guess(stamp_s, reason)
        self._guessed, self._blind_covariance = self._guessed @ guess.motion, self._blind_covariance + guess.covariance
        return guess

    def rest(self, stamp_s: float) -> Motion:
        """The robot stood until this stamp, for which the last picture is still valid; a guess since that one stays, so
        that the next picture undoes it."""
        self._last_s = stamp_s
        self._coasting.saw(SE2(), stamp_s)
        return no_motion()

    def _feed(self, feature: NDArray[np.float32]) -> SE2:
        outputs = self._network.run({self._head.feature_input: feature, **self._states})
        self._states, self._fed = {state.input: outputs[state.output] for state in self._head.states}, self._fed + 1
        return SE2(*outputs[self._head.motion][0])
