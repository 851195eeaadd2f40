"""Learned odometry: a network run step by step, with its recurrent state as input and output."""

import math
from dataclasses import replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.odometry.flow_cells import flow_cells
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, blind_motion, first_motion, no_motion
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.manifest import Manifest, OdometryHead
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import cell_grid

SHORTEST_DT_S = 1e-3  # from keyframe to frame; after a gap of LONGEST_DT_S the head starts again
NOMINAL_DT_S = 0.1  # between the frames of its training; for a first frame
SEARCH_CELLS = 7  # by which the flow head searches a cell to either side
MARGIN = 0.05  # share of a span of the envelope, or of its upper end, that a camera may lie outside without a word
ROUNDING = 0.01  # of the envelope's numbers


def initial_states(head: OdometryHead) -> Tensors:
    """Fresh recurrent states by input name, filled with their initial values."""
    return {state.input: np.full(state.shape, state.initial, dtype=np.float32) for state in head.states}


class LearnedOdometry:
    """A head of the bundle: `paper`, or `flow`, which also reads the camera's geometry and the time between frames.

    flow measures from a keyframe, whose features its state holds, to each frame; it returns the increments, which
    compose to the measured motion. Its state advances where the frame becomes the next keyframe: nearest to the time
    between the frames that it was trained on, since its errors hardly shrink with the time between pictures (at 30 Hz
    motions from picture to picture drift up to nine times as much as those from every third), or where half of
    `reach_rad` is reached. Raises OdometryError
    where the bundle has none, or an untrained one.
    """

    needs_features = True

    def __init__(
        self,
        bundle: Bundle,
        kind: str,
        camera: FloorCamera,
        coasting: CoastingRule | None = None,
    ) -> None:
        self.name, self._coasting_rule = kind, coasting
        self._head, self._network = bundle.odometry_head(kind)
        if not self._head.trained:
            raise OdometryError(
                f"the {kind} odometry of bundle {bundle.manifest.name} is untrained: its motion is noise "
                "(edgemap train odometry --head paper)"
            )
        sigmas = (self._head.sigma_forward_m, self._head.sigma_left_m, self._head.sigma_yaw_rad)
        self._covariance = np.diag(np.square(sigmas))
        self._geometry: Tensors = {}
        self._camera, self._input, self._mount = camera, bundle.manifest.detector.input, camera.mount
        self._reach_rad = math.inf
        self._warning: Fault | None = None  # how the camera lies outside what the head was trained on
        if self._head.geometry is not None:
            self._set_mount(camera.mount)
            outside = outside_envelope(bundle.manifest, camera)
            self._warning = Fault(FaultKind.UNTRAINED_CAMERA, f"flow odometry: {outside}") if outside else None
        self.reset("start")

    @property
    def warning(self) -> Fault | None:
        """How the camera lies outside the head's training envelope; None where it does not."""
        return self._warning

    @property
    def reach_rad(self) -> float:
        """Largest rotation since a keyframe that the head can measure, as far as it searches to either side; infinite
        for `paper`."""
        return self._reach_rad

    def _set_mount(self, mount: Mount) -> None:
        """Compute the cells' geometry for a mount with these angles."""
        spec, lens = self._head.geometry, self._camera.intrinsics
        if spec is None:
            return
        grid = cell_grid(self._input, lens.width, lens.height, spec.stride)
        cells, pose = flow_cells(replace(self._camera, mount=mount), grid)
        self._geometry, self._mount = {spec.cells: cells, spec.mount: pose}, mount
        self._reach_rad = math.atan(SEARCH_CELLS * spec.stride / (grid.scale[0] * lens.fx))

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """Feed this frame's features; the first ones after a reset give identity."""
        seen = prior.attitude and prior.attitude.mount
        if seen and seen.used != self._mount:
            self._set_mount(seen.used)
        dt_s, step_s, self._last_s = frame.stamp_s - self._keyframe_s, frame.stamp_s - self._last_s, frame.stamp_s
        if not self._fresh and self._geometry and not (step_s >= SHORTEST_DT_S and dt_s <= LONGEST_DT_S):
            self._start_again()
        fresh, self._fresh = self._fresh, False
        if self._head.window and self._fed > self._head.window:
            self._states, self._fed = initial_states(self._head), 0
            self._feed(self._last, NOMINAL_DT_S)
            self._states = self._next_states
        motion, covariance = self._feed(features, NOMINAL_DT_S if fresh else dt_s)
        since, blind = self._since, self._blind_covariance
        self._since, self._blind_covariance = motion, np.zeros((3, 3))
        old = dt_s + step_s / 2.0 >= NOMINAL_DT_S or abs(motion.yaw_rad) >= self._reach_rad / 2.0
        if fresh or old or not self._geometry:
            self._next_keyframe(frame.stamp_s)
        if fresh and math.isfinite(step_s):
            text = f"{self.name} odometry: {step_s:.3f} s since the last frame, started again"
            return blind_motion(Fault(FaultKind.ODOMETRY, text))
        if fresh:
            self._coasting.begin(frame.stamp_s)
            return first_motion(*([self._warning] if self._warning else []))
        if not (np.isfinite(motion.vector()).all() and np.isfinite(covariance).all()):
            self._start_again()
            text = f"{self.name} odometry: motion not finite at frame {frame.index}, state reset"
            return blind_motion(Fault(FaultKind.OUT_OF_RANGE, text))
        motion = since.inverse() @ motion
        self._coasting.saw(motion, frame.stamp_s)
        return Motion(motion, covariance + blind)

    def step_blind(self, stamp_s: float, reason: Fault, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """A guess; the next picture measures the motion since the keyframe."""
        guess = self._coasting.guess(stamp_s, reason)
        self._since, self._blind_covariance = self._since @ guess.motion, self._blind_covariance + guess.covariance
        return guess

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """None: only pictures show whether the robot stands."""
        return None

    def rest(self, stamp_s: float) -> Motion:
        """The robot stood until this stamp: the next motion is measured from a keyframe at it."""
        self._last_s = stamp_s
        self._next_keyframe(stamp_s)
        self._coasting.saw(SE2(), stamp_s)
        return no_motion()

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again from the initial states."""
        self._start_again()
        self._coasting, self._last_s, self._keyframe_s = Coasting(self._coasting_rule), -math.inf, -math.inf
        self._blind_covariance = np.zeros((3, 3))  # of what was guessed since the last picture

    def _start_again(self) -> None:
        self._states, self._fed = initial_states(self._head), 0
        self._next_states, self._since = self._states, SE2()  # after the last frame; motion since the keyframe
        self._last: Tensors = {}
        self._fresh = True

    def _next_keyframe(self, stamp_s: float) -> None:
        """Makes the last frame the keyframe. stamp_s: latest stamp at which its picture is still valid."""
        self._states, self._keyframe_s, self._since = self._next_states, stamp_s, SE2()

    def _feed(self, features: Tensors, dt_s: float) -> tuple[SE2, np.ndarray]:
        head, tensors = self._head, dict(self._geometry)
        if head.geometry is not None:
            tensors[head.geometry.dt] = np.array([[dt_s]], dtype=np.float32)
        outputs = self._network.run({head.feature_input: features[head.feature], **tensors, **self._states})
        self._next_states = {state.input: outputs[state.output] for state in head.states}
        self._last, self._fed = {head.feature: features[head.feature]}, self._fed + 1
        covariance = self._covariance
        if head.geometry is not None:
            covariance = outputs[head.geometry.covariance][0].astype(np.float64)
        return SE2(*outputs[head.motion][0]), (covariance + covariance.T) / 2.0


def outside_envelope(manifest: Manifest, camera: FloorCamera) -> str:
    """One line on how this camera differs from those that the bundle's odometry was trained with; empty where not."""
    lens, mount = camera.intrinsics, camera.mount
    left, right = lens.rays([(0.0, lens.cy), (lens.width - 1.0, lens.cy)])[:, 0]
    values = {
        "height_m": mount.height_m,
        "pitch_deg": math.degrees(mount.pitch_rad),
        "horizontal_view_deg": math.degrees(math.atan(right) - math.atan(left)),
    }
    outside = []
    for name, value in values.items():
        if name in manifest.envelope:
            low, high = manifest.envelope[name]
            margin = MARGIN * max(high - low, abs(high)) + ROUNDING  # a head of one camera has no span
            if not low - margin <= value <= high + margin:
                outside.append(f"{name} {value:.2f} (trained on {low:g} to {high:g})")
    return f"the camera is outside what it was trained on: {', '.join(outside)}" if outside else ""
