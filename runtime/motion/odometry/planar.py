"""Odometry without a neural network: it tracks corners from frame to frame and keeps them as landmarks."""

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, GyroRotation, TrackedDirection, TrackedRotation
from edgemap.geometry.camera.carried import Carried, CarriedRule
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.odometry.landmarks import (
    BELOW_COUNT,
    KNOWN_DEPTH,
    TURN_M,
    Landmarks,
    Located,
    Noise,
    Viewpoint,
    displacement,
    excess_scale,
    locate,
    medians,
    new_landmarks,
    project,
    reduce_tilt,
    refined,
    rescaled,
    rotated,
    rotation_between,
    scaled_by_floor,
    with_neighbours_depth,
)
from edgemap.geometry.odometry.planar import planar_motion
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.odometry.two_view import travelled
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, first_motion, no_motion
from edgemap.runtime.network.network import Tensors

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]

LEVELS = 3  # levels of the tracker's pyramid; with two, tracking fails when a robot starts to spin suddenly
LARGE_PX = 31  # a structure that is larger counts half when a corner is refined
SHIFT_PX = 4  # the picture's shift is estimated on every n-th pixel
RESPONSE_PX = 3  # radius around a corner in which its response reads the picture
MASK_PX = 8  # the floor mask is computed on every n-th pixel
SHORTEST_S = 1e-3  # minimum time between two pictures
FEW = 5  # a fifth of the corners: fewer missing ones are not replaced, and fewer of a keyframe give no direction. Fewer
# with an estimated depth do not keep the scale; then corners below the horizon count as floor immediately
MINIMUM_COVARIANCE = np.diag([1e-4, 1e-4, 1e-4]) ** 2


@dataclass(frozen=True, slots=True)
class PlanarRule:
    """How planar odometry tracks and weights corners. Lengths are in `Platform.unit_m`, one metre for home robots.

    working_width_px: wider pictures are scaled down to this width. window_px: size of the tracker's window; corners are
    at least half of it apart. corners: number of corners. floor_share: share of the corners that are sought where the
    floor is within reach. shift_response: minimum response of the phase correlation; the picture's shift is then used
    for motions beyond the reach of the tracker. reach_heights: range, in camera heights, beyond which no corner counts
    as floor. max_age: lifetime of a landmark, frames. track_sigma_px, drift_sigma_px: standard deviation of one tracked
    corner at the working width, and of its drift in one frame. levelling: share of a tilt that is attributed to the
    landmarks instead of the camera. trusted_share: share of the tracks that must agree. If fewer agree, a new set of
    landmarks is tried, except on wheels, where the new set doubles the scale as often as it corrects it. agrees_more:
    factor by which more tracks must agree with the new set, because its landmarks are less certain. least_weight:
    minimum total weight of the tracks that agree. scale_drift_per_s: relative drift of the scale that the landmarks
    keep while no floor is in view. carried: rule for a carried camera, and for one on wheels. rise_per_rad: a carried
    camera also rises and sinks, by this share of the mount's height for each radian beyond `carried.level_rad`.
    lateral_share: as in `Rolling`, for robots on wheels. A robot that slides in most of the steps with much floor in
    view counts as able to drive sideways. travelled_rad: median motion of the corners, without the rotation, at which
    the direction of motion is measured. gyro_rad, gyro_share: standard deviation of the rotation that a gyro measures
    between two pictures of a carried camera: a constant part, and a part relative to the rotation, because samples and
    pictures are not exactly synchronous. A tilt correction from an IMU rotates the landmarks and does not count as
    motion.
    """

    working_width_px: int = 320
    window_px: int = 11
    corners: int = 160
    floor_share: float = 0.6
    shift_response: float = 0.15
    reach_heights: float = 12.0
    max_age: int = 30
    track_sigma_px: float = 0.3
    drift_sigma_px: float = 0.1
    levelling: float = 0.25
    trusted_share: float = 0.4
    agrees_more: float = 1.3
    least_weight: float = 8.0
    scale_drift_per_s: float = 0.1
    carried: CarriedRule = field(default_factory=CarriedRule)
    lateral_share: float = 0.01
    travelled_rad: float = 0.035
    rise_per_rad: float = 0.5
    gyro_rad: float = math.radians(0.05)
    gyro_share: float = 0.03

    @property
    def apart_px(self) -> int:
        """Minimum distance between two corners, px."""
        return (self.window_px + 1) // 2


class PlanarOdometry:
    """KLT corners (Lucas and Kanade 1981, Shi and Tomasi 1994) as landmarks, and the pose relative to them (`locate`).

    If a step measures no motion, `Coasting` predicts it.
    """

    name, needs_features = "planar", False

    def __init__(
        self,
        camera: FloorCamera,
        rule: PlanarRule | None = None,
        coasting: CoastingRule | None = None,
        seed: int = 0,
    ) -> None:
        self._rule = rule = rule or PlanarRule()
        scale = min(1.0, rule.working_width_px / camera.intrinsics.width)
        size = round(camera.intrinsics.width * scale), round(camera.intrinsics.height * scale)
        self._size = size
        self._unit_m = unit_m = camera.mount.platform.unit_m
        self._in_room = camera.mount.platform.in_room
        self._level = self._camera = FloorCamera(camera.intrinsics.scaled(*size), _in_units(camera.mount, unit_m))
        focal = self._level.intrinsics.fx
        noise = Noise(rule.track_sigma_px / focal, rule.drift_sigma_px / focal)
        self._level_noise = self._noise = noise
        self._reach_m = rule.reach_heights * self._level.mount.height_m
        self._rays = _ray_table(self._camera)
        self._coarse = self._rays[MASK_PX // 2 :: MASK_PX, MASK_PX // 2 :: MASK_PX]
        self._reached = self._within_reach(self._level)
        self._mask = self._mask_before = self._reached
        self._sees_floor = False  # the bundle has a floor head
        self._window: MatLike | None = None  # suppresses edge effects of the phase correlation
        self._attitude: Attitude | None = None
        self._mount = camera.mount  # the mount that attitudes refer to
        self._carried = Carried(rule.carried)
        known = camera.mount.forward_m != 0.0 or camera.mount.left_m != 0.0
        axle_m = 0.0 if known else self._level.mount.height_m  # not measured: assumed equal to the height of the lens
        self._rolling = Rolling(rule.lateral_share, 0.0, axle_m)
        self._spacing_px = math.sqrt(size[0] * size[1] / max(rule.corners, 1))  # mean distance of corners
        self._slides = 0.0  # share of recent steps in which the floor contradicts rolling
        self._seed, coasting = seed, coasting or CoastingRule()
        self._coasting, self._unseen_m_s = Coasting(coasting), coasting.speed_sigma_m_s
        self.reset("start")

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """Tracks the corners of the previous frame into this frame and estimates the motion between both."""
        return self._metric(self._followed(frame, prior))

    def _metric(self, motion: Motion) -> Motion:
        """Converts a motion from the camera's unit of length to metres."""
        units = np.array([self._unit_m, self._unit_m, 1.0])
        covariance = motion.covariance * np.outer(units, units)
        return replace(motion, motion=self._metres(motion.motion), covariance=covariance)

    def _metres(self, motion: SE2) -> SE2:
        return SE2(self._unit_m * motion.x_m, self._unit_m * motion.y_m, motion.yaw_rad)

    def _followed(self, frame: Frame, prior: FramePrior) -> Motion:
        """The motion in the camera's unit of length."""
        last, grey, dt_s = self._taken(frame, prior)
        self._attend(prior.attitude)
        self._mark_floor(prior.floor)
        first, self._first, self._seen_s = self._first, False, frame.stamp_s
        if last is None:
            self._floor_s = frame.stamp_s
            self._seek(grey)
            if first:
                self._coasting.begin(frame.stamp_s)
                return first_motion()
            fault = f"planar odometry: started again at {frame.stamp_s:.3f} s"
            return self._coasting.guess(frame.stamp_s, fault)
        self._follow(last, grey)
        found = self._locate(frame.index) if len(self._corners) >= self._rule.least_weight else None
        if found is None or found.weights.sum() < self._rule.least_weight:
            return self._guess(grey, frame)
        motion = (self._view.pose @ self._since).inverse() @ found.view.pose
        self._coasting.saw(motion, frame.stamp_s)
        rotation = np.eye(3)
        rotation[:2, :2] = motion.rotation()
        now = found.covariance[:3, :3]
        inflation = (len(found.weights) / found.weights.sum()) ** 2  # new tracks agree with any motion
        covariance = inflation * (self._covariance + rotation @ now @ rotation.T) + MINIMUM_COVARIANCE
        covariance += self._since_covariance
        scale2 = self._scale_variance(found, frame.stamp_s)
        covariance[:2, :2] += scale2 * np.outer(*[motion.vector()[:2]] * 2)
        if self._carried.on_wheels:  # a scale that has collapsed makes every motion small
            covariance[0, 0] += scale2 * (self._unseen_m_s * dt_s) ** 2
        # The tilt has errors too, so a better yaw does not improve the translation.
        if self._rotation_known and self._carried.beyond_rad > 0.0:
            covariance[:2, 2] = covariance[2, :2] = 0.0
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._learn_nodding(found.view, motion, dt_s)
        self._learn_rolling(found, motion)
        seen = self._seen_rotation(found)
        self._view, self._motion, self._covariance, self._trusted = found.view, motion, now, True
        self._landmarks, keep = refined(self._landmarks, found, self._noise)
        self._keep(keep & (self._landmarks.age < self._rule.max_age))
        held = self._in_room or int(self._landmarks.floor.sum()) >= BELOW_COUNT
        factor = excess_scale(self._landmarks, held)
        if factor != 1.0:
            self._landmarks = rescaled(self._landmarks, self._camera, self._view, factor, self._noise)
            motion = self._motion = SE2(motion.x_m / factor, motion.y_m / factor, motion.yaw_rad)
        if not self._predicted:
            self._landmarks, self._view = reduce_tilt(self._landmarks, self._camera, self._view, self._levelling)
        direction = self._travelled()
        self._seek(grey)
        return Motion(motion, covariance, rotation=replace(seen, travelled=direction))

    def _taken(self, frame: Frame, prior: FramePrior) -> tuple[MatLike | None, MatLike, float]:
        """The previous picture, None at a start, this one, and the time between both, s. Marks what moves."""
        grey = self._grey_of(frame)
        if self._grey is not None and frame.stamp_s - self._seen_s > LONGEST_DT_S:
            self._start_again()
        last, self._grey = self._grey, grey
        self._mark_movers(prior.movers * (self._size[0] / frame.image.shape[1]))
        return last, grey, frame.stamp_s - self._seen_s

    def _grey_of(self, frame: Frame) -> MatLike:
        """The picture in grey at the working width."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        return grey

    def step_blind(self, stamp_s: float, reason: str, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """Predicts the motion without a picture. The landmarks are kept; the next picture measures the motion since the
        previous picture.
        """
        guess, self._skipped = self._coasting.guess(stamp_s, reason), True
        self._since, self._since_covariance = self._since @ guess.motion, self._since_covariance + guess.covariance
        self._motion, self._trusted = guess.motion, False
        return self._metric(guess)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """None: this odometry cannot detect a standstill without pictures."""
        return None

    def rest(self, stamp_s: float) -> Motion:
        """Moves the stamp of the last picture and of its corners to this stamp, while the robot stands still."""
        if self._grey is not None:
            self._floor_s, self._seen_s = self._floor_s + stamp_s - self._seen_s, stamp_s
        self._motion = SE2()
        self._coasting.saw(SE2(), stamp_s)
        return no_motion()

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the next frame."""
        self._first, self._seen_s = True, -math.inf
        self._coasting.reset()
        self._start_again()

    def _start_again(self) -> None:
        self._grey: MatLike | None = None
        self._view, self._covariance = Viewpoint(), np.zeros((3, 3))
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._corners = self._before = np.zeros((0, 2), dtype=np.float32)
        self._landmarks = Landmarks.none()
        self._keyframe = self._view, self._camera, np.zeros((0, 3))  # rays then; NaN for later corners
        self._motion, self._trusted, self._tilt, self._skipped = SE2(), False, self._view.tilt, False
        self._rotation_known = self._predicted = False
        self._levelled_rad = math.inf  # sigma of the IMU tilt that the landmarks already include
        self._floor_s = self._seen_s

    def _scale_variance(self, found: Located, stamp_s: float) -> float:
        """Relative variance of the length of the motion. It grows while no floor is in view."""
        of_scale = self._landmarks.floor
        if float(found.weights[of_scale].sum()) >= self._rule.least_weight:
            self._floor_s = stamp_s
        drifted = self._rule.scale_drift_per_s * (stamp_s - self._floor_s)
        return drifted**2 + (self._noise.tilt_rad**2 if self._rotation_known else 0.0)

    def _attend(self, attitude: Attitude | None) -> None:
        """Updates the camera of this frame, the uncertainty of its attitude, and the rotation from a gyro."""
        self._camera_before = self._camera
        self._scatters(attitude)
        if attitude is not None and attitude is not self._attitude:
            self._attitude, self._camera = attitude, self._level.at(self._in_units(attitude))
            sigma = max(math.sqrt(float(np.trace(attitude.covariance_rad2)) / 2.0), self._level_noise.floor_tilt_rad)
            self._noise = replace(self._level_noise, tilt_rad=sigma)
            self._reached = self._within_reach(self._camera)
        ahead = attitude is not None and attitude.predicted and attitude.source != "mount"
        mount, share = self._mount, self._rule.levelling
        if attitude is not None and attitude.mount is not None and attitude.mount.used != mount:
            self._mount, share = attitude.mount.used, 1.0  # the landmarks were placed with an incorrect mount
        # The rotation or the mount of the previous camera was corrected; what remains of the tilt is an error.
        if ahead or self._predicted or self._mount != mount:
            _, tilt = rotated(self._view.tilt, self._camera_before, np.eye(3), self._camera)
            view = Viewpoint(self._view.pose, tilt, self._view.rise_m)
            self._landmarks, self._view = reduce_tilt(self._landmarks, self._camera, view, share)
            self._camera_before = self._camera
        self._predicted = ahead
        rotation = None if attitude is None or self._skipped else attitude.rotation
        self._rotation_known = rotation is not None
        self._tilt, self._levelling, self._skipped = self._view.tilt, self._rule.levelling, False
        if rotation is None:
            self._levelled_rad = math.inf
            return
        self._retilt(rotation)
        _, tilt = rotated(self._view.tilt, self._camera_before, rotation.rotation, self._camera)
        self._motion = SE2(self._motion.x_m, self._motion.y_m, rotation.yaw_rad)
        sigma = math.hypot(self._rule.gyro_rad + self._rule.gyro_share * rotation.angle_rad, rotation.sigma_rad)
        yaw_sigma = sigma if self._carried.beyond_rad > 0.0 else math.inf
        self._noise = replace(self._noise, yaw_rad=yaw_sigma, floor_tilt_rad=self._noise.tilt_rad)
        self._tilt, self._levelling = tilt, 0.0

    def _retilt(self, rotation: GyroRotation) -> None:
        """Updates the attitude of the previous picture's camera. The landmarks rotate with it by the share by which the
        variance of the tilt has decreased.
        """
        mount, sigma_rad = self._camera.mount, self._noise.tilt_rad
        up = rotation.rotation @ up_optical(mount.pitch_rad, mount.roll_rad)
        known = Attitude.of_up(up, np.eye(2) * sigma_rad**2, "imu")
        before = self._level.at(replace(known, height_m=self._camera_before.mount.height_m))
        _, tilt = rotated(self._view.tilt, self._camera_before, np.eye(3), before)
        share = max(1.0 - (sigma_rad / self._levelled_rad) ** 2, self._rule.levelling)
        drift = self._rule.levelling * max(sigma_rad**2 - self._levelled_rad**2, 0.0)
        self._levelled_rad = min(sigma_rad, math.sqrt(self._levelled_rad**2 + drift))
        view = Viewpoint(self._view.pose, tilt, self._view.rise_m)
        self._landmarks, self._view = reduce_tilt(self._landmarks, before, view, share)
        self._camera_before = before

    def _mark_floor(self, seen: FloorMask | None) -> None:
        """Marks where corners may lie on the floor: within reach and, with a floor mask, on its floor."""
        self._mask_before, self._mask, self._sees_floor = self._mask, self._reached, seen is not None
        if seen is not None:
            floor = cv2.resize(seen.floor, self._size, interpolation=cv2.INTER_LINEAR)
            self._mask = np.where(floor >= 0.5, self._reached, 0).astype(np.uint8)

    def _on_floor(self, mask: NDArray[np.uint8], corners: Pixels) -> NDArray[np.bool_]:
        """Whether each corner (N, 2) may count as floor immediately, (N,)."""
        columns, rows = corners.astype(np.intp).T
        trusted = mask[rows, columns] > 0 if self._sees_floor else np.asarray(self._trusting())
        return np.asarray(trusted & ~self._doubtful(corners))

    def _within_reach(self, camera: FloorCamera) -> NDArray[np.uint8]:
        """Mask: 255 where the floor is within reach, 0 elsewhere; computed on every `MASK_PX`-th pixel."""
        down = camera.mount.rotation_base_optical()[2]
        falls = -(self._coarse @ down[:2] + down[2]) / np.sqrt((self._coarse**2).sum(axis=2) + 1.0)
        reaches = (falls * self._reach_m > camera.mount.height_m).astype(np.uint8) * 255
        return np.asarray(cv2.resize(reaches, self._size, interpolation=cv2.INTER_NEAREST))

    def _mark_movers(self, boxes: NDArray[np.float64]) -> None:
        """Marks people and animals in `_still` with 0, all else with 255. boxes: (N, 4), px at the working width."""
        self._movers = boxes.astype(np.intp)
        self._still = np.full(self._size[::-1], 255, dtype=np.uint8)
        margin = self._rule.apart_px
        for x0, y0, x1, y1 in self._movers.tolist():
            self._still[max(y0 - margin, 0) : y1 + margin, max(x0 - margin, 0) : x1 + margin] = 0

    def _doubtful(self, corners: Pixels) -> NDArray[np.bool_]:
        """Whether each corner (N, 2) lies on a person or an animal, (N,)."""
        columns, rows = corners.astype(np.intp).T
        return self._still[rows, columns] == 0

    def _locate(self, index: int) -> Located:
        """The view with which the landmarks agree. If few agree, and more of a new set do, the view of the new set."""
        seen, noise = self._bearings(self._corners), self._noise_now()
        start = self._ahead(self._since @ self._motion)
        given = self._doubtful(self._corners), self._rolls()
        found = locate(self._landmarks, seen, self._camera, start, noise, *given)
        if self._sees_floor and self._carried.on_wheels:
            enough = self._rule.trusted_share, self._rule.least_weight
            self._landmarks, found = scaled_by_floor(
                self._landmarks, seen, self._camera, start, noise, found, enough, *given
            )
        agree = self._carried.on_wheels or found.weights.sum() > self._rule.trusted_share * len(seen)
        if self._trusted and agree:
            return found
        rays = _rays(self._bearings(self._before))
        still = ~self._doubtful(self._before)
        if self._sees_floor:
            still &= self._on_floor(self._mask_before, self._before)
        renewed = new_landmarks(rays, self._camera_before, self._view, self._noise, self._reach_m, still)
        before = self._camera_before.floor_points(self._before[renewed.floor])
        after = self._camera.floor_points(self._corners[renewed.floor])
        sigmas = 0.02 * np.hypot(before[:, 0], before[:, 1])
        rough = planar_motion(before, np.nan_to_num(after, nan=1e3), sigmas, np.random.default_rng((self._seed, index)))
        start = self._ahead(rough or self._since @ self._motion)
        other = locate(renewed, seen, self._camera, start, noise, *given)
        if other.weights.sum() < self._rule.agrees_more * found.weights.sum():
            return found
        self._landmarks = renewed
        return other

    def _rolls(self) -> tuple[SE2, Rolling] | None:
        """The previous pose and the rolling model, if the robot is on wheels and that pose was measured."""
        rolls = self._carried.on_wheels and self._slides < 0.5 and self._since == SE2()
        return (self._view.pose, self._rolling) if rolls else None

    def _learn_rolling(self, found: Located, motion: SE2) -> None:
        """Estimates the position of the axle, and whether the robot can drive sideways."""
        if found.lateral is not None:
            self._slides += (found.slid - self._slides) / self._rule.max_age
            self._rolling = self._rolling.learnt(*found.lateral, motion.yaw_rad)

    def _ahead(self, motion: SE2) -> Viewpoint:
        """The view after a motion, with the current tilt and the previous height."""
        return Viewpoint(self._view.pose @ motion, self._tilt, self._view.rise_m)

    def _seen_rotation(self, found: Located) -> TrackedRotation:
        """Rotation of the camera since the previous picture, relative to the landmarks."""
        rotation = rotation_between(self._view, self._camera_before, found.view, self._camera)
        return TrackedRotation(rotation, math.sqrt(float(np.trace(found.covariance[3:5, 3:5]))), self._carried)

    def _travelled(self) -> TrackedDirection | None:
        """Direction in which the lens moved since the keyframe, after the corners have moved enough. Then a new
        keyframe begins. It uses no landmark depth, because the depth of floor landmarks depends on the mount.
        """
        view, camera, rays = self._keyframe
        now = _rays(self._bearings(np.asarray(self._corners, dtype=np.float32)))
        both = np.isfinite(rays[:, 0])
        found = None
        if both.sum() >= self._rule.corners // FEW:
            first, second = rays[both], now[both]
            rotation = rotation_between(view, camera, self._view, self._camera)
            turned = second @ rotation.T
            across, down = (turned[:, :2] / turned[:, 2:] - first[:, :2]).T
            if float(np.median(np.hypot(across, down))) < self._rule.travelled_rad:
                return None
            way = displacement(view, camera, self._view, self._camera)
            length = float(np.linalg.norm(way))
            if length > 0.0:
                found = travelled(first, second, rotation, way / length, self._noise.track_rad)
        self._keyframe = self._view, self._camera, now
        return found

    def _learn_nodding(self, found: Viewpoint, motion: SE2, dt_s: float) -> None:
        """Updates the nodding between pictures. A camera that nods is carried by a person, and its height varies."""
        before, now = self._camera_before.mount, self._camera.mount
        pitch_rad = now.pitch_rad + found.tilt.pitch_rad - before.pitch_rad - self._view.tilt.pitch_rad
        roll_rad = now.roll_rad + found.tilt.roll_rad - before.roll_rad - self._view.tilt.roll_rad
        self.sways((pitch_rad**2 + roll_rad**2) / 2.0, self._metres(motion), dt_s, self._rotation_known)

    def sways(self, nod2: float, motion: SE2, span_s: float, gyro: bool, attitude: Attitude | None = None) -> Carried:
        """Updates and returns the estimate of whether the camera is carried. Call it once for each picture.

        nod2: mean square of the changes of roll and pitch since the previous picture, rad^2. motion: since the
        previous picture, metres. span_s: time since the previous picture. gyro: whether a gyro measured the rotation.
        """
        self._scatters(attitude)
        path_m = math.hypot(motion.x_m, motion.y_m) + TURN_M * abs(motion.yaw_rad)
        self._carried = self._carried.updated(nod2, max(span_s, SHORTEST_S), path_m, gyro=gyro)
        return self._carried

    def _in_units(self, attitude: Attitude) -> Attitude:
        """An attitude whose height is in the camera's unit of length."""
        return attitude if attitude.height_m is None else replace(attitude, height_m=attitude.height_m / self._unit_m)

    def _scatters(self, attitude: Attitude | None) -> None:
        """Takes over the estimate from the edges of the room."""
        if attitude is not None and attitude.carried != self._carried.scattered:
            self._carried = replace(self._carried, scattered=attitude.carried)

    def _noise_now(self) -> Noise:
        """Uncertainty of this picture's tilt and height."""
        known_height = self._attitude is not None and self._attitude.height_m is not None
        carried_rad = 0.0 if known_height else self._carried.beyond_rad
        rise_m = max(self._rule.rise_per_rad * carried_rad * self._camera.mount.height_m, self._noise.rise_m)
        return replace(self._noise, rise_m=rise_m)

    def _guess(self, grey: MatLike, frame: Frame) -> Motion:
        """Handles a tracking failure: starts with new corners at the predicted view."""
        guess = self._coasting.guess(
            frame.stamp_s, f"planar odometry: no motion agrees among {len(self._corners)} floor corners"
        )
        self._view = self._ahead(self._since @ guess.motion)
        self._motion, self._trusted = guess.motion, False
        self._since, self._since_covariance = SE2(), np.zeros((3, 3))
        self._keep(np.zeros(len(self._corners), dtype=bool))
        self._seek(grey)
        return guess

    def _follow(self, last: MatLike, grey: MatLike) -> None:
        """Tracks the corners. Those that fail or leave the picture are dropped with their landmarks."""
        if len(self._corners) == 0:
            return
        expected = self._expected()
        if not self._rotation_known:
            expected += self._surprise(last, grey, expected)
        moved, good = self._moved(last, grey, expected)
        self._before, self._corners = self._corners, moved
        inside = ((self._corners >= 0) & (self._corners <= [self._size[0] - 1.0, self._size[1] - 1.0])).all(axis=1)
        good &= inside
        self._before = self._before[good]
        self._keep(good)

    def _expected(self) -> Pixels:
        """Where the corners are expected in this picture, (N, 2) px."""
        projection = project(self._landmarks, self._camera, self._ahead(self._since @ self._motion))
        expected = self._camera.intrinsics.project(
            np.column_stack([projection.predicted, np.where(projection.ahead, 1.0, np.nan)])
        )
        return np.where(np.isfinite(expected), expected, self._corners).astype(np.float32)

    def _moved(self, last: MatLike, grey: MatLike, expected: Pixels) -> tuple[Pixels, NDArray[np.bool_]]:
        """The corners in this picture (N, 2), by halves of the pictures and then by their detail; which were found."""
        if not self._in_room:  # KITTI from frame 500: 5.6 %, with detail 7.9
            return self._tracked(last, grey, self._corners, expected, LEVELS)
        halves = cv2.pyrDown(last), cv2.pyrDown(grey)
        coarse, near = self._tracked(*halves, self._corners / 2.0, expected / 2.0, LEVELS - 1)
        moved, good = self._tracked(_detail(last), _detail(grey), self._corners, 2.0 * coarse, 0)
        return moved, near & good

    def _tracked(
        self, last: MatLike, grey: MatLike, corners: Pixels, expected: Pixels, levels: int
    ) -> tuple[Pixels, NDArray[np.bool_]]:
        """Corners (N, 2) of one picture tracked into another from where they are expected, and whether they were."""
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            last, grey, corners[:, None], expected[:, None].copy(), winSize=[self._rule.window_px] * 2,
            maxLevel=levels, criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-4,
        )  # fmt: skip
        return np.asarray(moved.reshape(-1, 2), dtype=np.float32), status.reshape(-1) == 1

    def _surprise(self, last: MatLike, grey: MatLike, expected: Pixels) -> Pixels:
        """Unexpected shift of the picture, (2,) px; zero unless it is more than the tracker can follow."""
        width, height = self._size[0] // SHIFT_PX, self._size[1] // SHIFT_PX
        if self._window is None:
            self._window = cv2.createHanningWindow((width, height), cv2.CV_32F)
        small = [cv2.resize(p, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) for p in (last, grey)]
        if len(self._movers):
            still = cv2.resize(self._still, (width, height), interpolation=cv2.INTER_NEAREST)
            small = [np.where(still, p - cv2.mean(p, still)[0], 0.0).astype(np.float32) for p in small]
        shift, response = cv2.phaseCorrelate(small[0], small[1], self._window)
        surprise = SHIFT_PX * np.array(shift) - medians(expected - self._corners)
        clear = response > self._rule.shift_response and np.hypot(*surprise) > self._rule.window_px / 2 * 2**LEVELS
        return surprise.astype(np.float32) if clear else np.zeros(2, dtype=np.float32)

    def _keep(self, which: NDArray[np.bool_]) -> None:
        self._corners, self._landmarks = self._corners[which], self._landmarks.chosen(which)
        self._keyframe = *self._keyframe[:2], self._keyframe[2][which]

    def _seek(self, grey: MatLike) -> None:
        """Replaces missing corners separately on the floor and elsewhere: a wall's contrast must not hide the floor."""
        missing = self._rule.corners - len(self._corners)
        if missing < self._rule.corners // FEW:
            return
        free = np.full(grey.shape, 255, dtype=np.uint8)
        for corner in self._corners.astype(np.intp).tolist():
            cv2.circle(free, corner, self._rule.apart_px, 0, -1)
        floors = self._floor_count()
        for mask, have, share in (
            (free & self._mask, floors, self._rule.floor_share),
            (free & ~self._mask, len(self._corners) - floors, 1.0 - self._rule.floor_share),
        ):
            wanted = round(share * self._rule.corners) - have
            if wanted <= 0:
                continue
            lines = np.flatnonzero(mask.any(axis=1))
            if not len(lines):
                continue
            top, bottom = max(lines[0] - RESPONSE_PX, 0), lines[-1] + 1 + RESPONSE_PX
            found = cv2.goodFeaturesToTrack(
                grey[top:bottom], wanted, 0.005, self._rule.apart_px, mask=mask[top:bottom], blockSize=3
            )
            if found is None:
                continue
            fresh = np.asarray(found.reshape(-1, 2) + [0.0, top], dtype=np.float32)
            self._begin(fresh)

    def _floor_count(self) -> int:
        """Number of corners on the floor."""
        return int(self._landmarks.floor.sum())

    def _begin(self, fresh: Pixels) -> None:
        """Landmarks of new corners (N, 2)."""
        rays = _rays(self._bearings(fresh))
        trusting = self._on_floor(self._mask, fresh)
        new = new_landmarks(rays, self._camera, self._view, self._noise, self._reach_m, trusting)
        if self._carried.on_wheels:
            apart2 = ((fresh[:, None] - self._corners) ** 2).sum(axis=2)
            near = np.exp(-apart2 / (2.0 * self._spacing_px**2))
            new = with_neighbours_depth(new, near, self._landmarks, self._camera, self._view, self._noise)
        self._corners, self._landmarks = np.concatenate([self._corners, fresh]), self._landmarks.joined(new)
        rays = np.concatenate([self._keyframe[2], np.full((len(fresh), 3), np.nan)])
        self._keyframe = *self._keyframe[:2], rays

    def _trusting(self) -> bool:
        """Whether corners below the horizon count as floor immediately."""
        kept, lost_s = self._landmarks, self._seen_s - self._floor_s
        known = int((kept.floor | (kept.variance < (KNOWN_DEPTH * kept.inverse_m) ** 2)).sum())
        return known < self._rule.corners // FEW or (self._carried.on_wheels and lost_s > LONGEST_DT_S)

    def _bearings(self, pixels: Pixels) -> Array:
        """Normalised image points (N, 2) without lens distortion, interpolated in a table of all pixels."""
        corner = np.clip(pixels.astype(np.intp), 0, [self._size[0] - 2, self._size[1] - 2])
        part = pixels - corner
        u, v = corner.T
        a, b = part[:, :1], part[:, 1:]
        table = self._rays
        return (1 - b) * ((1 - a) * table[v, u] + a * table[v, u + 1]) + b * (
            (1 - a) * table[v + 1, u] + a * table[v + 1, u + 1]
        )


def _in_units(mount: Mount, unit_m: float) -> Mount:
    """A mount with its lengths in units of `unit_m`."""
    return replace(
        mount, height_m=mount.height_m / unit_m, forward_m=mount.forward_m / unit_m, left_m=mount.left_m / unit_m
    )


def _detail(grey: MatLike) -> MatLike:
    """A picture in which large structures have half their contrast: they pull corners of weakly textured floors along,
    which makes a robot appear slower (home 9001: by 16 % before a wall)."""
    return cv2.addWeighted(grey, 1.0, cv2.blur(grey, (LARGE_PX, LARGE_PX)), -0.5, 64.0)


def _rays(bearings: Array) -> Array:
    return np.column_stack([bearings, np.ones(len(bearings))])


def _ray_table(camera: FloorCamera) -> Array:
    """Normalised image points of all pixels, (height, width, 2)."""
    height, width = camera.intrinsics.height, camera.intrinsics.width
    v, u = np.mgrid[0:height, 0:width]
    return camera.intrinsics.rays(np.column_stack([u.ravel(), v.ravel()]))[:, :2].reshape(height, width, 2)
