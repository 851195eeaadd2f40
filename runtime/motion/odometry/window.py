"""Odometry by pictures: tracked corners in a sliding window of keyframes, optimised together."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, GyroRotation, TrackedRotation, rotation_angle
from edgemap.geometry.camera.carried import Carried, CarriedRule
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.odometry.keyframe_window import KeyframeWindow, WindowRule, heading_slope, rows_of
from edgemap.geometry.odometry.resection import LensPose
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.odometry.window_factors import PoseFactors
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.corners import CornersRule, CornerTracker, Pixels
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, Odometry, first_motion, no_motion
from edgemap.runtime.network.network import Tensors

SHORTEST_S = 1e-3  # minimum time between two pictures
LEAST_SIGMA = 1e-4  # m and rad, of a motion and of a tilt
TURN_M = 0.2  # path of a turn, per radian


@dataclass(frozen=True, slots=True)
class PicturesRule:
    """How corners are tracked, and how the window weights them. Lengths are in `Platform.unit_m`, one metre for home
    robots. Pairs are for a robot and for a carried camera; between both, `Carried.share` interpolates."""

    corners: CornersRule = field(default_factory=CornersRule)
    window: WindowRule = field(default_factory=WindowRule)
    carried: CarriedRule = field(default_factory=CarriedRule)  # for a carried camera, and for one on wheels
    # A picture becomes a keyframe where the tracks have moved by this much since the last one, the rotation aside.
    parallax_px: tuple[float, float] = (8.0, 15.0)
    # Factor on the covariance of a motion whose scale is not measured by depth: its errors last. Between 1 and this
    # where a share of the depths is measured.
    covariance_scale: float = 16.0
    least_weight: float = 8.0  # minimum total weight of the tracks that agree
    agreeing_share: float = 1 / 3  # a pose that a smaller share of the tracks agrees with is doubted
    # Standard deviation of the lens's height about the mount's, as a share of it; from picture to picture half as much.
    height_share: tuple[float, float] = (0.004, 0.025)
    attitude_pictures: float = 10.0  # number of pictures for which an error of a measured attitude lasts
    slip_share: float = 0.01  # lateral slip of wheels, as of `Rolling`
    gyro_rad: float = math.radians(0.05)  # standard deviation of the rotation that a gyro measures between two pictures
    gyro_share: float = 0.03  # the same relative to the rotation: samples and pictures are not exactly synchronous


class WindowOdometry(Odometry):
    """Corners (`CornerTracker`) and the lens's poses in a `KeyframeWindow`; the base's motion is planar.

    Pitch, roll and height of each keyframe are estimated together with the motion, so an error of the attitude hardly
    changes the length of a step. Where a frame has depth, the inverse depths of its corners are measured. A robot is
    about the mount's angles to half of `tilt.nod`, keeps its height and, once it has proved to be on wheels, rolls; a
    carried camera is about them to `tilt.prior`. A room's edges show the tilt to `tilt.seen`. If a step measures no
    motion, `Coasting` predicts it. Lengths inside are in the platform's unit. carried: whether the camera counts as
    carried from the start.
    """

    name = "window"

    def __init__(
        self,
        camera: FloorCamera,
        rule: PicturesRule | None = None,
        coasting: CoastingRule | None = None,
        tilt: MountTiltRule | None = None,
        carried: bool = False,
    ) -> None:
        self._rule, tilt = rule or PicturesRule(), tilt or MountTiltRule()
        self._unit_m, self._in_room = camera.mount.platform.unit_m, camera.mount.platform.in_room
        window = replace(self._rule.window, depth_sigma=self._unit_m * self._rule.window.depth_sigma)
        self._tilt_rad, self._edges_rad = (tilt.nod / 2.0, tilt.prior), tilt.seen
        self._tracker = CornerTracker(camera, self._rule.corners, self._unit_m)
        self._level = self._camera = FloorCamera(self._tracker.intrinsics, _in_units(camera.mount, self._unit_m))
        self._mount = camera.mount  # the mount that attitudes refer to
        begun = Carried(self._rule.carried, tilt.nod)
        self.judged = begun.certain() if carried else begun
        self._rolling = Rolling.of_mount(self._rule.slip_share, self._level.mount)
        self._coasting, self._seen_s = Coasting(coasting), -math.inf
        lens, mount, reach = self._level.intrinsics, self._level.mount, self._rule.corners.reach_heights
        self._graph, self._base = KeyframeWindow(window, lens.fx, mount, reach), SE2()
        self._motion, self._skipped = SE2(), False
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))  # of the motion without pictures

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """Tracks the corners of the previous frame into this frame and estimates the motion between both."""
        return self._metric(self._followed(frame, prior))

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """Predicts the motion without a picture. Keeps the tracks: the next picture measures the motion since the
        previous one.
        """
        guess, self._skipped = self._coasting.guess(stamp_s, reason), True
        self._since, self._since_covariance = self._since @ guess.motion, self._since_covariance + guess.covariance
        self._motion = guess.motion
        return self._metric(guess)

    def rest(self, stamp_s: float) -> Motion:
        """Moves the stamp of the last picture and of its corners to this stamp, while the robot stands still."""
        self._seen_s, self._motion = stamp_s, SE2()
        self._coasting.saw(SE2(), stamp_s)
        return no_motion()

    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        """The motion in the camera's unit of length."""
        dt_s, self._seen_s = frame.stamp_s - self._seen_s, frame.stamp_s
        gyro = self._attend(prior.attitude)
        span_s = dt_s if dt_s >= SHORTEST_S else math.inf
        self._tracker.take(frame, prior.movers, span_s, self._camera, prior.floor)
        factors = self._factors(prior.attitude, gyro)
        if not self._graph.poses:
            self._seek()
            mount = self._camera.mount
            self._begin(LensPose(mount.rotation_base_optical(), mount.position_base_m()), factors)
            self._coasting.begin(frame.stamp_s)
            return first_motion()
        if dt_s > LONGEST_DT_S:
            self._motion = SE2()
        start = self._expected_pose(gyro)
        expected_px = self._projected(self._tracker.ids, start)
        expected_px = np.where(np.isfinite(expected_px), expected_px, self._tracker.corners)
        self._tracker.follow(expected_px, gyro is None, self._detail())
        ids, before, late = self._tracker.tracks_before()
        self._graph.begin_again(ids, before, late)
        tracks = self._tracker.tracks()
        expected, weight = self._graph.resected(start, tracks, factors)
        pose = expected
        if weight < max(self._rule.least_weight, self._rule.agreeing_share * len(tracks)):
            pose, weight = self._surprised(pose, weight, factors)
        if not (surprised := pose is not expected):
            self._graph.average_late(ids, late)
            self._find_lost(pose)
        self._seek()
        step = None
        if weight >= self._rule.least_weight:
            parallax_px, carried = self._held(self._rule.parallax_px), surprised or self.judged.carried
            self._graph.step(pose, factors, self._tracker.tracks(), parallax_px, carried)
            self._tracker.keep(self._graph.pictures)
            step = self._measured(frame.stamp_s, None if surprised else dt_s, gyro is not None)
        return step or self._started_again(frame, start, factors)

    def _seek(self) -> None:
        """Replaces missing corners; of a carried camera without depth more are sought."""
        self._tracker.seek(self.judged.share * self._graph.unmeasured(), self._detail())

    def _detail(self) -> bool:
        """Whether large structures count half and corners are spread: what is carried turns fast, and large turns need
        large structures and strong corners; so do roads."""
        return self._in_room and not self.judged.carried

    def _surprised(self, pose: LensPose, weight: float, factors: PoseFactors) -> tuple[LensPose, float]:
        """The pose of a picture that does not agree with the expected motion, and the weight of its tracks: the camera
        has stopped, a light was switched, or pictures were lost while it drove on. Descriptors find corners."""
        tracker = self._tracker
        one = len(self._graph.poses) == 1  # after one surprise follows another, as of noise
        far_px = self._rule.corners.window_px if weight >= self._rule.least_weight else 0.0
        if one or (found := tracker.find_again(far_px)) is None:
            return pose, weight
        before, turn, way = found
        self._graph.add(before)
        seen = tracker.tracks()
        start = self._graph.bridge(seen, turn, way)
        return self._graph.resected(start, seen, factors)

    def _find_lost(self, pose: LensPose) -> None:
        """Corners that were lost since an earlier keyframe are tracked from its picture into one with this pose."""
        graph, tracker = self._graph, self._tracker
        ids, poses = graph.lost(tracker.ids)
        numbers, near_px = np.array(graph.pictures)[poses], self._rule.window.gate_px
        expected, before = self._projected(ids, pose), self._projected(ids, graph.poses[-1])
        found = tracker.find_lost(ids, numbers, expected, before, near_px, self._detail())
        graph.see_again(found, poses[rows_of(found, ids)])

    def _attend(self, attitude: Attitude | None) -> GyroRotation | None:
        """Updates the camera of this frame; returns the rotation since the last picture by a gyro."""
        if attitude is not None and attitude.carried != self.judged.scattered:
            self.judged = replace(self.judged, scattered=attitude.carried)
        self._camera = self._level
        if attitude is not None:
            height_m = None if attitude.height_m is None else attitude.height_m / self._unit_m
            self._camera = self._level.at(replace(attitude, height_m=height_m))
        gyro = None if attitude is None or self._skipped else attitude.rotation
        gyro = gyro if gyro is not None and gyro.proved else None  # of wrong axes it would lose the tracks
        used = self._mount if attitude is None or attitude.mount is None else attitude.mount.used
        turned_rad = math.hypot(used.pitch_rad - self._mount.pitch_rad, used.roll_rad - self._mount.roll_rad)
        self._mount = used
        if turned_rad > self._tilt_rad[0]:
            self._graph.loosen(self._camera.mount.rotation_base_optical()[2])
        if attitude is not None and attitude.predicted and attitude.room is not None and not self._skipped:
            self._graph.see_up(attitude.room.up, self._edges_rad)
        return gyro

    def _measured(self, stamp_s: float, dt_s: float | None, gyro: bool) -> Motion | None:
        """The motion up to the last picture, by the window's last two poses, and what it shows of the camera; None
        where no track ties the picture to those before. dt_s: between both pictures; None over a gap, whose nod does
        not show how the camera is held."""
        (before, pose), base = self._graph.poses[-2:], self._graph.base(self._graph.poses[-1])
        motion, level = (self._base @ self._since).inverse() @ base, self._base.rotation().T
        # Errors of its scale last, those of what a single motion shows do not.
        lasting = 1.0 + (self._rule.covariance_scale - 1.0) * self._graph.unmeasured()
        covariance, by, slope = lasting * self._graph.covariance, np.zeros((3, 12)), heading_slope(before)
        by[:2, 3:5], by[:2, 9:11], by[2, :3], by[2, 6:9] = -level, level, -slope, heading_slope(pose)
        by[0, :3], by[1, :3] = motion.y_m * slope, -motion.x_m * slope
        total = by @ covariance @ by.T + LEAST_SIGMA**2 * np.eye(3) + self._since_covariance
        step = Motion(motion, total, gap=dt_s is None)
        if not step.checked(self.name).measured:
            return None
        self._coasting.saw(motion, stamp_s, total)
        self._since, self._since_covariance, self._skipped = SE2(), np.zeros((3, 3)), False
        self._base, self._motion = base, motion
        self._rolling = self._rolling.observe(motion, total / lasting)
        self._graph.axle_m = self._rolling.axle_m
        if dt_s is not None:
            nod = pose.rotation[2] - before.rotation[2]
            path_m = self._unit_m * math.hypot(motion.x_m, motion.y_m) + TURN_M * abs(motion.yaw_rad)
            self.judged = self.judged.updated(float(nod @ nod) / 2.0, max(dt_s, SHORTEST_S), path_m, gyro=gyro)
        up_rad = math.sqrt(max(float(np.trace(covariance[6:8, 6:8])) / 2.0, 0.0))
        rotation = before.rotation.T @ pose.rotation
        return replace(step, rotation=TrackedRotation(rotation, self.judged, up=pose.rotation[2], up_rad=up_rad))

    def _started_again(self, frame: Frame, start: LensPose, factors: PoseFactors) -> Motion:
        """A new window, from the expected pose, after a picture that agrees with no motion."""
        text = f"camera odometry: no motion explains the picture ({len(self._tracker.corners)} corners)"
        guess = self._coasting.guess(frame.stamp_s, Fault(FaultKind.ODOMETRY, text))
        self._motion = guess.motion
        self._begin(start, factors)
        return guess

    def _begin(self, start: LensPose, factors: PoseFactors) -> None:
        """A new window at this pose."""
        self._graph.clear()
        self._graph.step(start, factors, self._tracker.tracks())
        self._tracker.keep(self._graph.pictures)
        self._base = self._graph.base(start)
        self._since, self._since_covariance, self._skipped = SE2(), np.zeros((3, 3)), False

    def _factors(self, attitude: Attitude | None, gyro: GyroRotation | None) -> PoseFactors:
        """Gravity, height, gyro and wheels as factors of this picture's pose."""
        rule, height_m = self._rule, self._camera.mount.height_m
        height_sigma_m = self._held(rule.height_share) * height_m
        up_rad = self._held(self._tilt_rad)
        if attitude is not None and attitude.source != "mount" and not attitude.predicted:
            variance = float(np.trace(attitude.covariance_rad2)) / 2.0
            up_rad = max(math.sqrt(rule.attitude_pictures * variance), LEAST_SIGMA)
        gyro_rad = math.inf
        if gyro is not None:
            gyro_rad = math.hypot(rule.gyro_rad + rule.gyro_share * rotation_angle(gyro.rotation), gyro.sigma_rad)
        return PoseFactors(
            up=self._camera.mount.rotation_base_optical()[2],
            up_rad=up_rad,
            height_m=height_m,
            height_sigma_m=height_sigma_m,
            rise_m=height_sigma_m / 2.0,
            gyro=np.eye(3) if gyro is None else gyro.rotation,
            gyro_rad=gyro_rad,
            slip_m=self._rolling.slip_m(self._motion) if self.judged.on_wheels and not self._skipped else math.inf,
        )

    def _held(self, pair: tuple[float, float]) -> float:
        """A value between a robot's and a carried camera's, by `Carried.share`."""
        robot, carried = pair
        return robot * (carried / robot) ** self.judged.share

    def _expected_pose(self, gyro: GyroRotation | None) -> LensPose:
        """The expected pose: the last motion again, with the gyro's rotation."""
        last = self._graph.poses[-1]
        moved = self._base @ self._since @ self._motion @ self._base.inverse()
        turn = np.eye(3)
        turn[:2, :2] = moved.rotation()
        rotation = turn @ last.rotation if gyro is None else last.rotation @ gyro.rotation
        return LensPose(rotation, turn @ last.position_m + [moved.x_m, moved.y_m, 0.0])

    def _projected(self, ids: NDArray[np.int64], pose: LensPose) -> Pixels:
        """Points of the window in a picture of this pose, (N, 2) px; NaN for those that it has not or that are behind
        the lens."""
        local = self._graph.local(ids, pose)
        return self._tracker.intrinsics.project(np.where(local[:, 2:] > 0.1, local, np.nan)).astype(np.float32)

    def _metric(self, motion: Motion) -> Motion:
        """Converts a motion from the camera's unit of length to metres."""
        units = np.array([self._unit_m, self._unit_m, 1.0])
        covariance = motion.covariance * np.outer(units, units)
        return replace(motion, motion=motion.motion.scaled(self._unit_m), covariance=covariance)


def _in_units(mount: Mount, unit_m: float) -> Mount:
    """A mount with its lengths in units of `unit_m`."""
    return replace(
        mount, height_m=mount.height_m / unit_m, forward_m=mount.forward_m / unit_m, left_m=mount.left_m / unit_m
    )
