"""Negative evidence: an object in plain view that is not detected, look after look, is no longer there."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.default_map import FloorMap
from edgemap.geometry.detections import Detections
from edgemap.geometry.floor import FloorCamera
from edgemap.geometry.floor_map import MapObject, ObjectMap
from edgemap.geometry.se2 import SE2
from edgemap.geometry.visibility import ViewRule, expected_boxes, in_plain_view, iou


@dataclass(frozen=True, slots=True)
class ForgetRule:
    """How soon an object is doubted.

    surest, gone: log-odds that an object has at most, and below which it leaves. frame_weight: of one frame's look, as
    neighbouring frames repeat each other's misses. false_rate: how often something is detected where nothing stands.
    prior_hits, prior_looks: what is known of a class's detection rate before any look. same_iou: a box of its label
    that overlaps the expected one this much counts as a look at it, whichever object it went to. trusted_rate: no miss
    weighs as if the detection rate were higher, as what was always seen may be missed for a while from one side; with
    these numbers an object takes at least eight misses in a row to leave.
    """

    surest: float = 2.5
    gone: float = -2.0
    frame_weight: float = 0.5
    false_rate: float = 0.05
    prior_hits: float = 5.6
    prior_looks: float = 8.0
    same_iou: float = 0.3
    trusted_rate: float = 0.72
    view: ViewRule = field(default_factory=ViewRule)


class _Rate:
    """How often what is in plain view is detected. pending: misses since the last hit, which may mean that it left."""

    def __init__(self) -> None:
        self.hits = self.looks = self.pending = 0

    def add(self, hits: int, looks: int) -> None:
        self.hits, self.looks = self.hits + hits, self.looks + looks


class NeverForgets:
    """For maps that keep whatever they have seen."""

    def look(
        self,
        floor_map: ObjectMap,  # noqa: ARG002
        detections: Detections,  # noqa: ARG002
        pose_map_base: SE2,  # noqa: ARG002
        object_ids: Sequence[str],  # noqa: ARG002
    ) -> list[str]:
        """Nothing leaves the map."""
        return []


class Forgetter:
    """Keeps the log-odds that each object of the map is still there. looks: clear looks so far, by id."""

    def __init__(self, camera: FloorCamera, rule: ForgetRule | None = None) -> None:
        self.camera, self.rule = camera, rule or ForgetRule()
        self.looks: dict[str, int] = defaultdict(int)
        self._log_odds: dict[str, float] = {}
        self._own: dict[str, _Rate] = defaultdict(_Rate)
        self._class: dict[str, _Rate] = defaultdict(_Rate)

    def look(
        self, floor_map: ObjectMap, detections: Detections, pose_map_base: SE2, object_ids: Sequence[str]
    ) -> list[str]:
        """Weigh one frame, after the map has taken in its sightings; the ids that leave the map by it.

        detections: all boxes of the frame. pose_map_base: where they were seen from. object_ids: objects sighted. Only
        the default map can forget: the paper's is made of all sightings ever.
        """
        if not isinstance(floor_map, FloorMap):
            return []
        objects = self._concerned(floor_map.objects(), pose_map_base, set(object_ids))
        boxes = expected_boxes(objects, self.camera, pose_map_base)
        clear = in_plain_view(objects, boxes, self.camera, pose_map_base, detections, self.rule.view)
        labels, sighted, gone = np.array(detections.labels, dtype=object), set(object_ids), []
        for row, item in enumerate(objects):
            hit = item.id in sighted
            if not hit and not clear[row]:
                continue
            like = detections.boxes[labels == item.label] if len(detections) else np.zeros((0, 4))
            if not hit and (iou(boxes[row], like) >= self.rule.same_iou).any():
                continue
            if self._weigh(item, hit, bool(clear[row])) < self.rule.gone:
                floor_map.drop(item.id)
                gone.append(item.id)
                del self._log_odds[item.id]
            elif self._log_odds[item.id] < self.rule.surest:
                floor_map.doubt(item.id, 1.0 / (1.0 + math.exp(-self._log_odds[item.id])))
            else:
                floor_map.doubt(item.id, 1.0)
        return gone

    def _concerned(self, objects: list[MapObject], pose_map_base: SE2, sighted: set[str]) -> list[MapObject]:
        """Those sighted, and those near enough and ahead, for which geometry is worth its time."""
        if not objects:
            return []
        places = pose_map_base.inverse().apply(np.array([item.position_m for item in objects]))
        near = (places[:, 0] > 0.0) & (np.linalg.norm(places, axis=1) <= self.rule.view.farthest_m)
        return [item for item, close in zip(objects, near, strict=True) if close or item.id in sighted]

    def detection_rate(self, item: MapObject) -> float:
        """How often this object is detected when in plain view: its own looks over its class's over the prior."""
        rule, own, kind = self.rule, self._own[item.id], self._class[item.label]
        usual = (kind.hits + rule.prior_hits) / (kind.looks + rule.prior_looks)
        rate = (own.hits + usual * rule.prior_looks) / (own.looks + rule.prior_looks)
        return min(max(rate, 2.0 * rule.false_rate), 0.95)

    def _weigh(self, item: MapObject, hit: bool, clear: bool) -> float:
        rule, rate = self.rule, self.detection_rate(item)
        missed = 1.0 - min(rate, rule.trusted_rate)
        ratio = rate / rule.false_rate if hit else missed / (1.0 - rule.false_rate)
        now = self._log_odds.get(item.id, rule.surest) + rule.frame_weight * math.log(ratio)
        self._log_odds[item.id] = min(now, rule.surest)
        if clear:
            own = self._own[item.id]
            self.looks[item.id] += 1
            own.pending += 1
            if hit:  # so it was there all the while
                for rates in (own, self._class[item.label]):
                    rates.add(1, own.pending)
                own.pending = 0
        return self._log_odds[item.id]
