"""Checks a mount's angles against a room's edges, motion parallel to the floor, rotations, gravity and depth."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import cv2
import numpy as np
from cv2.typing import MatLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, MountEstimate, RoomHeading, TrackedRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.level import angles_text, pitch_roll
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTilt, MountTiltRule
from edgemap.geometry.robust import CLEAR_SIGMAS, median_and_scatter
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.runtime.motion.attitude.protocol import AttitudeSource, Moved
from edgemap.runtime.motion.attitude.segments import line_ends, segments_between
from edgemap.runtime.motion.health import HealthRule

FEWEST = 4  # estimates; the median deviation of fewer says nothing
COARSE_PX = (40, 30)  # of the pictures that are compared
EDGES, GRAVITY, DEPTH = "the room's edges", "gravity", "the floor in depth pictures"


@dataclass(frozen=True, slots=True)
class MountRule:
    """When a mount counts as wrong.

    pixels: pictures are scaled down to so many (192 x 144). strips: that a picture is cut into; their edges are
    found one a frame, as all at once take a third of a step. every_s, first_every_s: between two estimates by
    edges, once the mount is confirmed, and before or where the camera is carried; every_s also between two
    judgements. window_s: of estimates that are judged together; judged_s: their minimum, and the span of a turn and
    of the accelerometer's samples that count as one measurement. settled_rad: standard deviation at which a mount on
    wheels is known for good: what is seen while it sways as if carried is left aside then, and before voids all that
    was seen. tilt: how measurements count.
    """

    pixels: int = 27_648
    strips: int = 3
    every_s: float = 1.0
    first_every_s: float = 0.35
    window_s: float = 20.0
    judged_s: float = 5.0
    settled_rad: float = math.radians(0.45)
    tilt: MountTiltRule = field(default_factory=MountTiltRule)


class CheckedMount:
    """Another source's attitude, about a mount whose angles all measurements together estimate (`MountTilt`).

    Where they clearly contradict the mount, a fault is reported once, and their estimate is used from then on. A
    carried camera has no mount and is not checked. Edge measurements of single frames are passed to `pictures`, which
    may be the wrapped source or one behind it. health: by which a picture shows another view (`moved`).
    """

    def __init__(
        self,
        camera: FloorCamera,
        other: AttitudeSource,
        pictures: PicturesAttitude,
        rule: MountRule | None = None,
        health: HealthRule | None = None,
    ) -> None:
        self.name = other.name
        self._other, self._pictures, self._rule = other, pictures, rule or MountRule()
        self._moved = (health or HealthRule()).moved  # grey levels
        mount, lens = camera.mount, camera.intrinsics
        self._in_room = mount.platform.in_room
        self._mount, self._given = mount, np.array([mount.roll_rad, mount.pitch_rad])
        self._to_base = mount.rotation_base_optical()
        share = min(1.0, math.sqrt(self._rule.pixels / (lens.width * lens.height)))
        self._lens = lens.scaled(round(lens.width * share), round(lens.height * share))
        self._tilt = MountTilt.given(self._rule.tilt)
        self._estimated: MountEstimate | None = None
        self._wrong, self._corrected = np.zeros(2, dtype=bool), np.zeros(2)  # which angle is wrong, and by how much
        self._correct = mount
        self._judged_s = -math.inf
        self._plain: Attitude | None = None  # the other source's last one, and what became of it with what was known
        self._answer, self._answered_for = Attitude.of_mount(mount), (False, self._estimated)
        self._turned, self._turned_s, self._now_s = np.eye(3), -math.inf, -math.inf  # rotation since a stamp
        self._forces: list[tuple[float, float, float]] = []  # stamp, roll and pitch by the accelerometer
        self._steady = self._confirmed = self._carried = self._on_wheels = False
        self._sways = False  # at the last picture, as if carried
        self._settled = False  # the mount is known well enough for the whole drive
        self._room: RoomHeading | None = None  # by the edges of the last picture, if just found
        self._last: MatLike | None = None
        self._first_s, self._started_s = math.inf, -math.inf  # of the first picture, and of the one looked at
        self._strips: list[tuple[int, MatLike]] = []  # of it, not looked at yet, with their first columns
        self._ends: list[Array] = []  # of the edges found in the others
        self._estimates: deque[tuple[float, float, float]] = deque()  # stamp, roll and pitch against the mount

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:
        """The attitude at the frame's stamp."""
        self._room, self._now_s = None, frame.stamp_s
        self._look(frame)
        fault = self._judge()
        other = self._other.predict(frame, moved)
        self._measure(other)
        fault = "; ".join(filter(None, (other.fault, fault)))
        state = self._carried, self._estimated
        if fault or self._room or other is not self._plain or state != self._answered_for:
            carried, mount = state
            self._answer = replace(other, fault=fault, carried=carried, room=self._room, mount=mount)
        self._plain, self._answered_for = None if fault or self._room else other, state
        return self._answer

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The other source's, where it could only predict."""
        self._travel(rotation)
        other = self._other.update(rotation)
        return replace(other, carried=self._carried, mount=self._estimated) if self._answer.predicted else self._answer

    def correct_mount(self, mount: Mount) -> None:
        """Passes the mount to the source that is checked."""
        self._other.correct_mount(mount)

    def reset(self, reason: str) -> None:
        """Resets the wrapped source; the estimate of the mount stays."""
        self._other.reset(reason)
        self._estimates.clear()
        self._strips, self._ends = [], []

    def _look(self, frame: Frame) -> None:
        """A part of the work on a picture, the next one if none is begun."""
        if self._ends and not self._strips:
            ends, self._ends = np.concatenate(self._ends), []
            self._estimate(ends)
            return
        if not self._strips and self._due(frame.stamp_s):
            self._begin(frame)
        first = self._started_s == self._first_s  # all at once: a carried camera may be tilted by far
        for _ in range(len(self._strips) if first else min(len(self._strips), 1)):
            left, strip = self._strips.pop()
            self._ends.append(line_ends(strip, 1.0) + [left, 0.0])

    def _due(self, stamp_s: float) -> bool:
        """Whether it is time for the next picture. On a road none is due: its edges are not a room's."""
        if not self._in_room:
            return False
        self._first_s = min(self._first_s, stamp_s)
        settled = self._confirmed and not self._carried
        return stamp_s - self._started_s >= (self._rule.every_s if settled else self._rule.first_every_s)

    def _begin(self, frame: Frame) -> None:
        """Take a picture for an estimate, if it shows another view than the last one: one view is one measurement."""
        self._started_s = frame.stamp_s
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        grey = cv2.resize(grey, (self._lens.width, self._lens.height), interpolation=cv2.INTER_AREA)
        coarse = cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA)
        if self._last is not None and not _is_another(coarse, self._last, self._moved):
            return
        edges = np.linspace(0, self._lens.width, self._rule.strips + 1).astype(int).tolist()
        self._pictures.begin_edges()
        self._last, self._strips = coarse, [(left, grey[:, left:right]) for left, right in pairwise(edges)]

    def _estimate(self, ends: Array) -> None:
        """Estimate the mount by the edges of one picture, (N, 2, 2) px."""
        rule = self._rule
        edges = segments_between(ends, self._lens)
        found = self._pictures.see_edges(edges.normals, edges.lengths)
        if found is None:
            return
        if found.level_rad is not None:
            self._room = RoomHeading(self._started_s, found.level_rad, found.level_sigma_rad)
        pitch, roll = pitch_roll(found.up)
        error_rad = np.array([roll, pitch]) - self._given
        self._estimates.append((self._started_s, *error_rad.tolist()))
        while self._estimates[0][0] < self._started_s - rule.window_s:
            self._estimates.popleft()
        estimates = np.array(self._estimates)
        if not (self._settled and self._sways):
            self._tilt = self._tilt.by_up(EDGES, error_rad)
        if len(estimates) < FEWEST or estimates[-1, 0] - estimates[0, 0] < rule.judged_s:
            return
        self._steady = bool(median_and_scatter(estimates[:, 1:])[1].max() < 2.0 * rule.tilt.nod)
        self._carried, self._confirmed = not self._steady, self._steady

    def _travel(self, rotation: TrackedRotation | None) -> None:
        """Motion and turns of a robot on wheels."""
        rule, carried = self._rule, rotation and rotation.carried
        self._sways = bool(carried and carried.share > 0.0)
        if self._sways:
            self._void()
        self._on_wheels = carried.on_wheels if carried else self._on_wheels
        if rotation is None or carried is None or not carried.on_wheels:
            self._turned, self._turned_s = np.eye(3), self._now_s
            return
        if rotation.travelled is not None:
            covariance = self._to_base @ rotation.travelled.covariance @ self._to_base.T
            self._tilt = self._tilt.by_direction(self._to_base @ rotation.travelled.direction, covariance)
        self._turned = self._turned @ rotation.rotation
        if self._now_s - self._turned_s > rule.judged_s:
            if self._in_room:  # a car leans in turns, and its road rises
                self._tilt = self._tilt.by_turn(self._to_base @ cv2.Rodrigues(self._turned)[0].ravel())
            self._turned, self._turned_s = np.eye(3), self._now_s

    def _void(self) -> None:
        """A camera that is carried has no mount: what it showed is void, unless the mount was known before."""
        if not self._settled:
            self._tilt = MountTilt.given(self._rule.tilt)

    def _measure(self, attitude: Attitude) -> None:
        """Take in gravity and the floor in a depth picture."""
        rule = self._rule
        if attitude.force_rad is not None and GRAVITY not in self._tilt.measurements:
            self._forces.append((self._now_s, *attitude.force_rad.tolist()))
            if self._now_s - self._forces[0][0] >= rule.judged_s:
                forces, self._forces = np.array(self._forces)[:, 1:], []
                if forces.std(axis=0).max() < rule.tilt.seen:
                    self._tilt = self._tilt.by_up(GRAVITY, forces[-1] - self._given)  # which the filter has averaged
        if attitude.source == "depth":
            angles = np.array([attitude.roll_rad, attitude.pitch_rad])
            self._tilt = self._tilt.by_up(DEPTH, angles - self._given)

    def _judge(self) -> str:
        """What is known of the mount, now and then; the fault, where it has just proved wrong."""
        rule, tilt = self._rule, self._tilt
        if not math.isfinite(self._judged_s):  # whether the camera is carried shows first
            self._judged_s = self._now_s
        if self._now_s - self._judged_s < rule.every_s or not tilt.measurements:
            return ""
        self._judged_s = self._now_s
        if self._carried:
            self._void()
            return ""
        sigma, known = tilt.sigma_rad(), self._wrong
        waits = EDGES in tilt.measurements and not (self._steady or self._on_wheels)
        wrong = (not waits) & (np.abs(tilt.error_rad) > CLEAR_SIGMAS * sigma)
        self._settled |= self._on_wheels and bool(sigma.max() < rule.settled_rad)
        self._wrong = known | wrong
        # A small error counts on a road: 0.3 degrees are 2 % of all distances (KITTI 00).
        used = self._wrong if self._in_room else self._wrong | (sigma < rule.settled_rad)
        error_rad = np.where(used, tilt.error_rad, 0.0)
        if np.abs(error_rad - self._corrected).max() > rule.tilt.lasting / 2.0:
            self._corrected, self._correct = error_rad, self._with(error_rad)
            self._other.correct_mount(self._correct)
        self._estimated = MountEstimate(self._with(tilt.error_rad), sigma, self._correct, self._mount)
        if not (wrong & ~known).any():
            return ""
        given, found = np.degrees(self._given), np.degrees(self._given + error_rad)
        names = ", ".join(sorted(tilt.measurements, key=lambda name: -tilt.measurements[name]))
        return (
            f"mount: {angles_text(given[1], given[0])} given, {names} give {angles_text(found[1], found[0])}, "
            "to {:.1f} and {:.1f}: used from now on, measure it again".format(*np.degrees(sigma[::-1]))
        )

    def _with(self, error_rad: Array) -> Mount:
        """The mount with other angles."""
        roll, pitch = (self._given + error_rad).tolist()
        return replace(self._mount, roll_rad=roll, pitch_rad=pitch)


def views_of(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Those that show another view than the one before of these, the first one included."""
    last: MatLike | None = None
    for frame in frames:
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        coarse = cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA)
        if last is None or _is_another(coarse, last, HealthRule().moved):
            last = coarse
            yield frame


def _is_another(coarse: MatLike, last: MatLike, moved: float) -> bool:
    """Whether coarse pictures show two views. moved: grey levels."""
    return float(cv2.absdiff(coarse, last).mean()) >= moved
