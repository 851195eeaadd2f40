"""Negative evidence: an object that is missed again and again, in plain view or where the picture shows floor in its
place, is no longer there."""

import math
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject, ObjectMap
from edgemap.geometry.objects.visibility import ViewRule, expected_boxes, floor_in_place, in_plain_view, iou
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2

NEAR_M = 20.0  # nothing farther is sighted


@dataclass(frozen=True, slots=True)
class ForgetRule:
    """How soon an object counts as removed.

    highest: upper bound of an object's log-odds; below its negative the object is removed. same_m, same_frames: frames
    with the robot moved or turned less than this (a radian as a metre), or fewer, are one observation, since their
    misses are correlated; it is a miss where the object is detected in none of them. false_rate: rate of detections
    where there is no object. prior_observations: of a class's detection rate, which is `trusted_rate` before any.
    same_iou: a box of its label that overlaps the expected one this much counts as an observation of it, whichever
    object it went to. trusted_rate: usual detection rate, and its upper bound in a miss's weight: even an object that
    was always detected may be missed for a while from one side.
    """

    highest: float = 3.3
    same_m: float = 0.12
    same_frames: int = 15
    false_rate: float = 0.05
    prior_observations: float = 8.0
    same_iou: float = 0.3
    trusted_rate: float = 0.8
    view: ViewRule = field(default_factory=ViewRule)


class _Rate:
    """How often an observation of what is in plain view shows it. pending: misses since the last hit, which may mean
    that it left."""

    def __init__(self) -> None:
        self.hits = self.observations = self.pending = 0

    def add(self, hits: int, observations: int) -> None:
        self.hits, self.observations = self.hits + hits, self.observations + observations


@dataclass(slots=True)
class _Visit:
    """Frames from about one place. seen: whether any of them shows the object, None where something like it was seen
    in its place."""

    pose_map_base: SE2
    frame: int
    seen: bool | None = False


class NoForgetting:
    """For maps that never remove an object."""

    def observe(self, *_: object) -> list[str]:
        """Removes nothing."""
        return []


class Forgetter:
    """Keeps the log-odds that each object of the map is still there. observations: clear observations so far, by id."""

    def __init__(self, camera: FloorCamera, rule: ForgetRule | None = None) -> None:
        self.camera, self.rule = camera, rule or ForgetRule()
        self.observations: dict[str, int] = defaultdict(int)
        self._frame = 0
        self._open: dict[str, _Visit] = {}
        self._log_odds: dict[str, float] = {}
        self._own: dict[str, _Rate] = defaultdict(_Rate)
        self._class: dict[str, _Rate] = defaultdict(_Rate)

    def observe(
        self,
        floor_map: ObjectMap,
        detections: Detections,
        pose_map_base: SE2,
        object_ids: Sequence[str],
        camera: FloorCamera | None = None,
        kept: Collection[str] = (),
        floor: FloorMask | None = None,
    ) -> list[str]:
        """Updates with one frame, after the map was updated with its sightings. Returns the ids to remove. detections:
        all boxes of the frame. pose_map_base: pose of the robot in this frame. object_ids: objects sighted. camera:
        with the frame's attitude, None for the level robot's. kept: ids of objects that a person has confirmed, which
        never leave. floor: where the picture shows floor; None where that is not known.
        """
        camera = camera or self.camera
        self._frame += 1
        sighted, gone = {floor_map.shown_as(identity) for identity in object_ids}, []
        objects = self._concerned(floor_map, pose_map_base, sighted)
        boxes = expected_boxes(objects, camera, pose_map_base)
        clear = in_plain_view(objects, boxes, camera, pose_map_base, detections, self.rule.view)
        if floor is not None:
            clear |= floor_in_place(objects, camera, pose_map_base, floor)
        labels = np.array(detections.labels, dtype=object)
        for row, item in enumerate(objects):
            if item.id in kept:
                floor_map.set_presence(item.id, 1.0)
                continue
            if item.id in sighted:
                self._hit(item, pose_map_base, bool(clear[row]))
            elif clear[row]:
                like = detections.boxes[labels == item.label] if len(detections) else np.zeros((0, 4))
                self._miss(item, pose_map_base, bool((iou(boxes[row], like) >= self.rule.same_iou).any()))
            else:
                continue
            log_odds = self._log_odds.get(item.id, self.rule.highest)
            if log_odds < -self.rule.highest and item.id not in sighted:
                floor_map.drop(item.id)
                gone.append(item.id)
                for known in (self._log_odds, self._open, self._own):
                    known.pop(item.id, None)
            else:
                presence = 1.0 / (1.0 + math.exp(-log_odds)) if log_odds < self.rule.highest else 1.0
                floor_map.set_presence(item.id, presence)
        return gone

    def _concerned(self, floor_map: ObjectMap, pose_map_base: SE2, sighted: set[str]) -> list[MapObject]:
        """Those near enough that are sighted or ahead, for which geometry is worth its time."""
        here = np.array([pose_map_base.x_m, pose_map_base.y_m])
        objects = floor_map.near(here, NEAR_M)
        if not objects:
            return []
        positions = pose_map_base.inverse().apply(np.array([item.position_m for item in objects]))
        ahead = positions[:, 0] > 0.0
        return [item for item, close in zip(objects, ahead, strict=True) if close or item.id in sighted]

    def detection_rate(self, item: MapObject) -> float:
        """Detection rate of this object in plain view, from its own observations, its class's and the prior."""
        rule, own, kind = self.rule, self._own[item.id], self._class[item.label]
        usual = (kind.hits + rule.trusted_rate * rule.prior_observations) / (
            kind.observations + rule.prior_observations
        )
        rate = (own.hits + usual * rule.prior_observations) / (own.observations + rule.prior_observations)
        return min(max(rate, 2.0 * rule.false_rate), 0.95)

    def _hit(self, item: MapObject, pose_map_base: SE2, clear: bool) -> None:
        """It is there: that weighs at once, and whatever is missed in the same observation does not."""
        self._weigh(item, self.detection_rate(item) / self.rule.false_rate)
        if clear:
            self._observation_at(item, pose_map_base).seen = True

    def _miss(self, item: MapObject, pose_map_base: SE2, like_it: bool) -> None:
        observation = self._observation_at(item, pose_map_base)
        if like_it and not observation.seen:
            observation.seen = None

    def _observation_at(self, item: MapObject, pose_map_base: SE2) -> _Visit:
        """The observation that this frame belongs to; an observation that ends by it is counted and weighed."""
        rule, observation = self.rule, self._open.get(item.id)
        if observation is not None:
            moved = observation.pose_map_base.inverse() @ pose_map_base
            same = math.hypot(moved.x_m, moved.y_m) < rule.same_m and abs(moved.yaw_rad) < rule.same_m
            if same and self._frame - observation.frame < rule.same_frames:
                return observation
            if observation.seen is not None:
                self._count(item, observation.seen)
        self._open[item.id] = _Visit(pose_map_base, self._frame)
        return self._open[item.id]

    def _count(self, item: MapObject, seen: bool) -> None:
        own = self._own[item.id]
        self.observations[item.id] += 1
        own.pending += 1
        if seen:  # so it was there all the while
            for rates in (own, self._class[item.label]):
                rates.add(1, own.pending)
            own.pending = 0
        else:
            missed = 1.0 - min(self.detection_rate(item), self.rule.trusted_rate)
            self._weigh(item, missed / (1.0 - self.rule.false_rate))

    def _weigh(self, item: MapObject, ratio: float) -> None:
        now = self._log_odds.get(item.id, self.rule.highest) + math.log(ratio)
        self._log_odds[item.id] = min(now, self.rule.highest)
