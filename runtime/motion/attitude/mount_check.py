"""Checks a mount's angles against a room's edges, rotations, gravity and depth."""

import math
from collections import deque
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from cv2.typing import MatLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, MountEstimate, RoomAxes, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount, pitch_roll
from edgemap.geometry.camera.mount_tilt import MountTilt, MountTiltRule
from edgemap.geometry.robust import CLEAR_SIGMAS, FEWEST, median_and_scatter
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.runtime.motion.attitude.segments import line_ends, segments_between
from edgemap.runtime.motion.health import HealthRule, Views

# Pictures are scaled down to so many (192 x 144; at twice the size edges are no more precise) and cut into so many
# strips: long level edges must not outweigh upright ones (go2_office over 1 m: whole pictures 6.9, strips 5.2 %).
PIXELS, STRIPS = 27_648, 3
EDGES, GRAVITY, DEPTH = "the room's edges", "gravity", "the floor in depth pictures"


@dataclass(frozen=True, slots=True)
class MountRule:
    """When a mount counts as wrong."""

    first_every_s: float = 0.35  # between two estimates by edges, until the mount is confirmed, and while carried
    judged_s: float = 5.0  # span of estimates, of a turn and of accelerometer samples that are judged together
    tilt: MountTiltRule = field(default_factory=MountTiltRule)  # weights of the measurements


class MountCheck:
    """The mount's angles as all measurements together estimate them (`MountTilt`).

    On wheels, their estimate is used once it has converged, if it is off by more than its standard deviation; where
    they clearly contradict the mount, at once, and a fault is reported. A carried camera has no mount and is not
    checked. Edges of single frames update `pictures`. health: by which a picture shows another view (`moved`). used:
    the mount that attitudes refer to. estimate: None before the first judgement. carried: whether the tilt by edges
    scatters more than a mounted camera's. room: its axes by the edges of the last frame, if just computed.
    """

    def __init__(self, camera: FloorCamera, pictures: PicturesAttitude, rule: MountRule, health: HealthRule) -> None:
        self._pictures, self._rule = pictures, rule
        self._mount, self._in_room = camera.mount, camera.mount.platform.in_room
        self._configured = np.array([self._mount.roll_rad, self._mount.pitch_rad])
        self._to_base = self._mount.rotation_base_optical()
        self._tilt = MountTilt.prior(rule.tilt)
        # Of roll and pitch: which is clearly wrong, which is replaced by its estimate, and the correction, rad.
        self._wrong, self._replaced, self._corrected = np.zeros(2, dtype=bool), np.zeros(2, dtype=bool), np.zeros(2)
        self.used = self._mount
        self.estimate: MountEstimate | None = None
        self.room: RoomAxes | None = None
        self._now_s = self._judged_s = -math.inf  # of the last frame, and of the last judgement
        self._turned, self._turned_s = np.eye(3), -math.inf  # rotation since a stamp
        self._forces: list[tuple[float, float, float]] = []  # stamp, roll and pitch by the accelerometer
        self._steady: bool | None = None  # whether the estimates by edges scatter as little as a mounted camera's
        self._on_wheels = self._sways = False  # by the odometry; at the last picture, as if carried
        self._settled = False  # the mount's angles have converged for the whole drive
        lens, self._views = camera.intrinsics, Views(health.moved)
        share = min(1.0, math.sqrt(PIXELS / (lens.width * lens.height)))
        self._lens = lens.scaled(round(lens.width * share), round(lens.height * share))
        self._picture: MatLike | None = None  # of the last frame, whose edges are to be read
        self._offered_s = -math.inf  # of the last picture that was due
        self._estimates: deque[tuple[float, float, float]] = deque()  # stamp, roll and pitch against the mount

    @property
    def carried(self) -> bool:
        """Whether the estimates by edges scatter more than a mounted camera's, of a mount that is not known yet."""
        return self._steady is False and not self._settled

    def see(self, frame: Frame) -> Fault | None:
        """Reads edges. Returns a fault when the mount has just proved wrong."""
        self.room = self._by_edges()
        self._now_s = frame.stamp_s
        self._picture = self._offered(frame)
        return self._judge()

    def _offered(self, frame: Frame) -> MatLike | None:
        """A frame's picture, where it is time for one and it shows another view than the last one: its edges are read
        once its tilt is measured. Of a road none is: its edges are not a room's."""
        every_s = EVERY_S if self._steady else self._rule.first_every_s
        if not self._in_room or frame.stamp_s - self._offered_s < every_s:
            return None
        self._offered_s = frame.stamp_s
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        grey = cv2.resize(grey, (self._lens.width, self._lens.height), interpolation=cv2.INTER_AREA)
        return grey if self._views.is_another(grey) else None

    def _by_edges(self) -> RoomAxes | None:
        """Estimates the mount by the edges of the last frame's picture. Returns the room where they show it."""
        if self._picture is None:
            return None
        rule, stamp_s = self._rule, self._now_s
        strips = np.array_split(self._picture, STRIPS, axis=1)
        lefts = np.cumsum([0, *(strip.shape[1] for strip in strips[:-1])])
        ends = [line_ends(strip, 1.0) + [left, 0.0] for strip, left in zip(strips, lefts, strict=True)]
        edges = segments_between(np.concatenate(ends), self._lens)
        room = self._pictures.see_edges(edges.normals, edges.lengths)
        if room is None:
            return None
        pitch, roll = pitch_roll(room.up)
        error_rad = np.array([roll, pitch]) - self._configured
        if not (self._settled and self._sways):
            self._tilt = self._tilt.by_up(EDGES, error_rad)
        self._estimates.append((stamp_s, *error_rad.tolist()))
        while len(self._estimates) > 1 and stamp_s - self._estimates[1][0] >= rule.judged_s:
            self._estimates.popleft()
        if len(self._estimates) >= FEWEST and stamp_s - self._estimates[0][0] >= rule.judged_s:
            scatter = median_and_scatter(np.array(self._estimates)[:, 1:])[1]
            self._steady = bool(scatter.max() < 2.0 * rule.tilt.nod)
        return replace(room, stamp_s=stamp_s)

    def moved(self, rotation: TrackedRotation | None) -> None:
        """Updates the mount with turns of a robot on wheels."""
        rule, carried = self._rule, rotation and rotation.carried
        self._sways = bool(carried and carried.share > 0.0)
        if self._sways:
            self._void()
        self._on_wheels = carried.on_wheels if carried else self._on_wheels
        if rotation is not None and carried is not None and carried.on_wheels and self._in_room:  # a car leans in turns
            self._turned = self._turned @ rotation.rotation
            if self._now_s - self._turned_s <= rule.judged_s:
                return
            self._tilt = self._tilt.by_turn(self._to_base @ cv2.Rodrigues(self._turned)[0].ravel())
        self._turned, self._turned_s = np.eye(3), self._now_s

    def _void(self) -> None:
        """Discards the estimate of a carried camera, which has no mount, unless it had converged before."""
        if not self._settled:
            self._tilt = MountTilt.prior(self._rule.tilt)

    def measure(self, attitude: Attitude) -> None:
        """Updates the mount with gravity and the floor in a depth picture."""
        rule = self._rule
        if attitude.force_rad is not None and GRAVITY not in self._tilt.measurements:
            self._forces.append((self._now_s, *attitude.force_rad.tolist()))
            if self._now_s - self._forces[0][0] >= rule.judged_s:
                forces, self._forces = np.array(self._forces)[:, 1:], []
                if forces.std(axis=0).max() < rule.tilt.seen:  # the filter has averaged the last one
                    self._tilt = self._tilt.by_up(GRAVITY, forces[-1] - self._configured)
        if attitude.source == "depth":
            angles = np.array([attitude.roll_rad, attitude.pitch_rad])
            self._tilt = self._tilt.by_up(DEPTH, angles - self._configured)

    def _judge(self) -> Fault | None:
        """Estimates the mount once a second. Returns a fault when it has just proved wrong."""
        rule, tilt = self._rule, self._tilt
        if not math.isfinite(self._judged_s):  # whether the camera is carried shows first
            self._judged_s = self._now_s
        if self._now_s - self._judged_s < EVERY_S or not tilt.measurements:
            return None
        self._judged_s = self._now_s
        if self._steady is False:
            self._void()
            return None
        sigma, reported = tilt.sigma_rad(), self._wrong
        waits = EDGES in tilt.measurements and not (self._steady or self._on_wheels)
        wrong = (not waits) & (np.abs(tilt.error_rad) > CLEAR_SIGMAS * sigma)
        self._settled |= self._on_wheels and bool(tilt.converged().all())
        self._wrong = reported | wrong
        self._replaced |= self._wrong | (self._settled & (np.abs(tilt.error_rad) > sigma))
        error_rad = np.where(self._replaced, tilt.error_rad, 0.0)
        if np.abs(error_rad - self._corrected).max() > rule.tilt.lasting / 2.0:
            self._corrected, self.used = error_rad, self._with(error_rad)
        self.estimate = MountEstimate(self._with(tilt.error_rad), sigma, self.used, self._mount)
        if not (wrong & ~reported).any():
            return None
        stated, estimate = np.degrees(self._configured), np.degrees(self._configured + error_rad)
        names = ", ".join(sorted(tilt.measurements, key=lambda name: -tilt.measurements[name]))
        return Fault(
            FaultKind.MOUNT_ANGLES,
            f"mount: {_angles(stated)} given, {names} give {_angles(estimate)}, "
            "to {:.1f} and {:.1f}: used from now on, measure it again".format(*np.degrees(sigma[::-1])),
        )

    def _with(self, error_rad: Array) -> Mount:
        """The mount with other angles."""
        roll, pitch = (self._configured + error_rad).tolist()
        return replace(self._mount, roll_rad=roll, pitch_rad=pitch)


def _angles(degrees: Array) -> str:
    """Roll and pitch (2,), degrees, for messages."""
    return f"pitch {degrees[1]:.1f} and roll {degrees[0]:.1f} deg"
