"""Checks the mount by the pictures: a room's straight edges give the up direction."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, RoomHeading, SeenRotation
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.robust import median_and_scatter
from edgemap.runtime.attitude.pictures import PicturesAttitude
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.calibration.level import angles_text, pitch_roll
from edgemap.runtime.calibration.segments import line_ends, segments_between
from edgemap.runtime.frame import Frame

Array = NDArray[np.float64]

COARSE_PX = (40, 30)  # of the pictures that are compared


@dataclass(frozen=True, slots=True)
class MountRule:
    """When a mount counts as wrong by the room's edges.

    pixels: pictures are scaled down to so many (192 x 144). strips: that a picture is cut into; their edges are found
    one after the other, `strip_s` apart, as all at once take a third of a step. every_s, first_every_s: between two
    estimates, once the mount is confirmed or after `first_s`, and before or where the camera is carried. window_s: of
    estimates that are judged together, judged_s and fewest: their minimum. steady_rad: maximum median scatter of the
    estimates of a mounted camera (0.3 degrees in rendered homes); a carried one is not judged. wrong_rad: error from
    which a mount is wrong; up to there the given one holds. moved: mean grey levels between two pictures that count as
    two views.
    """

    pixels: int = 27_648
    strips: int = 3
    strip_s: float = 0.09
    every_s: float = 1.5
    first_every_s: float = 0.35
    first_s: float = 10.0
    window_s: float = 20.0
    judged_s: float = 5.0
    fewest: int = 8
    steady_rad: float = math.radians(1.2)
    wrong_rad: float = math.radians(2.5)
    moved: float = 3.0


class CheckedMount:
    """Another source's attitude, about a mount that is checked against the edges of the room.

    Where they steadily give other angles than the mount's, that is reported once, as a fault, and theirs are used from
    then on. What they show of single frames goes to `pictures`, which may be the other source, or behind it.
    """

    def __init__(
        self,
        mount: Mount,
        lens: Intrinsics,
        other: AttitudeSource,
        pictures: PicturesAttitude,
        rule: MountRule | None = None,
    ) -> None:
        self.name = other.name
        self._other, self._pictures, self._rule = other, pictures, rule or MountRule()
        self._mount, self._given = mount, np.array([mount.roll_rad, mount.pitch_rad])
        share = min(1.0, math.sqrt(self._rule.pixels / (lens.width * lens.height)))
        self._lens = lens.scaled(round(lens.width * share), round(lens.height * share))
        self._offset = np.zeros(2)  # of the mount, roll and pitch, where it is wrong
        self._confirmed = self._carried = False
        self._room: RoomHeading | None = None  # by the edges of the last picture, if just found
        self._last: MatLike | None = None
        self._first_s, self._started_s = math.inf, -math.inf  # of the first picture, and of the one looked at
        self._strips: list[tuple[int, MatLike]] = []  # of it, not looked at yet, with their first columns
        self._ends: list[Array] = []  # of the edges found in the others
        self._estimates: deque[tuple[float, float, float]] = deque()  # stamp, roll and pitch against the mount

    def step(self, frame: Frame) -> Attitude:
        """The attitude at the frame's stamp."""
        self._room = None
        fault = self._look(frame)
        other = self._other.step(frame)
        if not (fault or self._carried or self._room or self._offset.any()):
            return other
        fault = "; ".join(filter(None, (other.fault, fault)))
        told = replace(other, fault=fault, carried=self._carried, room=self._room)
        if other.source == self._pictures.name:  # it knows of the offset
            return told
        roll, pitch = (np.array([other.roll_rad, other.pitch_rad]) + self._offset).tolist()
        return replace(told, roll_rad=roll, pitch_rad=pitch)

    def rotated(self, rotation: SeenRotation | None) -> Attitude:
        """The other source's; only pictures predict, and they know of the offset."""
        return replace(self._other.rotated(rotation), carried=self._carried)

    def reset(self, reason: str) -> None:
        """The mount and its offset stay."""
        self._other.reset(reason)
        self._estimates.clear()
        self._strips, self._ends = [], []

    def _look(self, frame: Frame) -> str:
        """A part of the work on a picture, the next one if none is begun; the fault, where the mount is wrong."""
        if self._ends and not self._strips:
            ends, self._ends = np.concatenate(self._ends), []
            return self._estimate(ends)
        if not self._strips and self._due(frame.stamp_s):
            self._begin(frame)
        first = self._started_s == self._first_s  # all at once: a carried camera may be tilted by far
        while self._strips and (first or frame.stamp_s - self._started_s >= len(self._ends) * self._rule.strip_s):
            left, strip = self._strips.pop()
            self._ends.append(line_ends(strip, 1.0) + [left, 0.0])
        return ""

    def _due(self, stamp_s: float) -> bool:
        """Whether it is time for the next picture."""
        self._first_s = min(self._first_s, stamp_s)
        settled = not self._carried and (self._confirmed or stamp_s - self._first_s >= self._rule.first_s)
        return stamp_s - self._started_s >= (self._rule.every_s if settled else self._rule.first_every_s)

    def _begin(self, frame: Frame) -> None:
        """Take a picture for an estimate, if it shows another view than the last one."""
        self._started_s = frame.stamp_s
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        grey = cv2.resize(grey, (self._lens.width, self._lens.height), interpolation=cv2.INTER_AREA)
        coarse = cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA)
        if self._last is not None and float(cv2.absdiff(coarse, self._last).mean()) < self._rule.moved:
            return
        edges = np.linspace(0, self._lens.width, self._rule.strips + 1).astype(int).tolist()
        self._pictures.begin_edges()
        self._last, self._strips = coarse, [(left, grey[:, left:right]) for left, right in pairwise(edges)]

    def _estimate(self, ends: Array) -> str:
        """Estimate the mount by the edges of one picture, (N, 2, 2) px."""
        edges = segments_between(ends, self._lens)
        found = self._pictures.see_edges(edges.normals, edges.lengths)
        if found is None:
            return ""
        if found.level_rad is not None:
            self._room = RoomHeading(self._started_s, found.level_rad, found.level_sigma_rad)
        pitch, roll = pitch_roll(found.up)
        self._estimates.append((self._started_s, *(np.array([roll, pitch]) - self._given).tolist()))
        while self._estimates[0][0] < self._started_s - self._rule.window_s:
            self._estimates.popleft()
        return self._judge()

    def _judge(self) -> str:
        rule, estimates = self._rule, np.array(self._estimates)
        if len(estimates) < rule.fewest or estimates[-1, 0] - estimates[0, 0] < rule.judged_s:
            return ""
        middle, scatter = median_and_scatter(estimates[:, 1:])
        steady = scatter.max() < rule.steady_rad
        self._carried = not steady
        off = np.abs(middle - self._offset).max()
        self._confirmed = bool(steady and off < rule.wrong_rad)
        if not steady or self._confirmed:
            return ""
        self._offset = middle
        roll, pitch = (self._given + middle).tolist()
        self._pictures.correct_mount(replace(self._mount, roll_rad=roll, pitch_rad=pitch))
        given, found = np.degrees(self._given), np.degrees(self._given + middle)
        return (
            f"mount: {angles_text(given[1], given[0])} given, the room's edges give {angles_text(found[1], found[0])} "
            f"({len(estimates)} pictures): used from now on, measure it again"
        )
