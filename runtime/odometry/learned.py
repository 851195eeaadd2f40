"""Learned odometry: a stepwise network whose recurrent state goes in and comes out explicitly."""

from __future__ import annotations

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import OdometryHead
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.session import Bundle, Network, Tensors


def initial_states(head: OdometryHead) -> Tensors:
    """Fresh recurrent states by input name, filled with their initial values."""
    return {state.input: np.full(state.shape, state.initial, dtype=np.float32) for state in head.states}


def advance(head: OdometryHead, network: Network, features: Tensors, states: Tensors) -> tuple[SE2, Tensors]:
    """One step of the network: features and states in, motion and states out. Nothing is kept here."""
    outputs = network.run({head.feature_input: features[head.feature], **states})
    forward_m, left_m, yaw_rad = (float(value) for value in outputs[head.motion][0])
    return SE2(forward_m, left_m, yaw_rad), {state.input: outputs[state.output] for state in head.states}


class LearnedOdometry:
    """The paper's ConvLSTM head of a bundle. Raises OdometryError where it is untrained and not `allow_untrained`."""

    name = "paper"

    def __init__(self, bundle: Bundle, kind: str = "paper", allow_untrained: bool = False) -> None:
        self._head, self._network = bundle.odometry_head(kind)
        if not self._head.trained and not allow_untrained:
            raise OdometryError(
                f"the {kind} odometry of bundle {bundle.manifest.name} is untrained: its motion is noise "
                "(--allow-untrained runs it all the same)"
            )
        sigmas = (self._head.sigma_forward_m, self._head.sigma_left_m, self._head.sigma_yaw_rad)
        self._covariance = np.diag(np.square(sigmas))
        self.reset("start")

    def step(self, frame: Frame, features: Tensors) -> Motion:
        """Feed this frame's features; the first ones after a reset give identity."""
        motion, self._states = advance(self._head, self._network, features, self._states)
        if self._fresh:
            self._fresh = False
            return Motion()
        if not np.isfinite(motion.vector()).all():
            self.reset("motion not finite")
            return Motion(fault=f"{self.name} odometry: motion not finite at frame {frame.index}, state reset")
        return Motion(motion, self._covariance)

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again from the initial states."""
        self._states = initial_states(self._head)
        self._fresh = True
