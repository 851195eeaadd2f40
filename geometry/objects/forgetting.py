"""Negative evidence: removes an object that is repeatedly missed in plain view, or where the picture shows floor in its
place."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.visibility import ViewRule, expected_boxes, floor_in_place, in_plain_view, iou
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeTrajectory

NEAR_M = 20.0  # nothing farther is sighted, and a step does not ask all objects of a large map
FIXTURES = frozenset({"bed", "couch", "dining table", "oven", "refrigerator", "toilet"})  # they stay in place


@dataclass(frozen=True, slots=True)
class ForgetRule:
    """How soon an object counts as removed."""

    misses: int = 5  # observations in a row that miss it
    # m or rad: frames with the robot moved or turned by less are one observation, as their misses are correlated; it is
    # a miss where the object is detected in none of them.
    same_m: float = 0.12
    # Overlap of a box of its label with the expected one that counts as an observation, whichever object the box is of.
    same_iou: float = 0.3
    view: ViewRule = field(default_factory=ViewRule)


@dataclass(slots=True)
class _Visit:
    """Frames from about one place. seen: whether any of them shows the object, None where an object of its class was
    detected in its place."""

    pose_map_base: SE2
    seen: bool | None = False


class Forgetter:
    """Counts how often each object of the map was missed since it was last detected. missing: objects that would have
    left but are kept."""

    def __init__(self, camera: FloorCamera, rule: ForgetRule | None = None) -> None:
        self.camera, self.rule = camera, rule or ForgetRule()
        self.missing: set[str] = set()
        self._open: dict[str, _Visit] = {}
        self._missed: dict[str, int] = defaultdict(int)

    def observe(
        self,
        floor_map: FloorMap,
        detections: Detections,
        pose_map_base: SE2,
        object_ids: Sequence[str],
        camera: FloorCamera | None = None,
        kept: Collection[str] = (),
        floor: FloorMask | None = None,
    ) -> None:
        """Updates with one frame, after the map was updated with its sightings. detections: all boxes of the frame.
        pose_map_base: pose of the robot in this frame. object_ids: objects sighted. camera: with the frame's attitude,
        None for the level robot's. kept: ids of objects that a person has confirmed, which never leave. floor: where
        the picture shows floor; None without a floor mask.
        """
        camera = camera or self.camera
        sighted = {floor_map.shown_as(identity) for identity in object_ids}
        objects = self._concerned(floor_map, pose_map_base, sighted)
        boxes = expected_boxes(objects, camera, pose_map_base)
        clear = in_plain_view(objects, boxes, camera, pose_map_base, detections, self.rule.view)
        if floor is not None:
            clear |= floor_in_place(objects, camera, pose_map_base, floor)
        labels = np.array(detections.labels, dtype=object)
        for row, item in enumerate(objects):
            if item.id in sighted:  # it is present, whatever was missed before and in the same observation
                if clear[row]:
                    self._observation_at(item, pose_map_base).seen = True
                self._missed[item.id] = 0
            elif clear[row]:
                observation = self._observation_at(item, pose_map_base)
                like = detections.boxes[labels == item.label] if len(detections) else np.zeros((0, 4))
                if not observation.seen and (iou(boxes[row], like) >= self.rule.same_iou).any():
                    observation.seen = None
            else:
                continue
            missed = self._missed[item.id]
            if item.id in kept:
                floor_map.set_presence(item.id, 1.0)
                (self.missing.add if missed >= self.rule.misses else self.missing.discard)(item.id)
            elif missed >= self.rule.misses:
                floor_map.drop(item.id)
                for counts in (self._missed, self._open):
                    counts.pop(item.id, None)
            else:
                floor_map.set_presence(item.id, 1.0 - missed / self.rule.misses)

    def _concerned(self, floor_map: FloorMap, pose_map_base: SE2, sighted: set[str]) -> list[MapObject]:
        """Objects near enough that are sighted or ahead; others cannot be in view."""
        objects = floor_map.near(np.array([pose_map_base.x_m, pose_map_base.y_m]), NEAR_M)
        if not objects:
            return []
        positions = pose_map_base.inverse().apply(np.array([item.position_m for item in objects]))
        ahead = positions[:, 0] > 0.0
        return [item for item, close in zip(objects, ahead, strict=True) if close or item.id in sighted]

    def _observation_at(self, item: MapObject, pose_map_base: SE2) -> _Visit:
        """The observation that this frame belongs to; an observation that ends by it is counted."""
        observation = self._open.get(item.id)
        if observation is not None:
            if (observation.pose_map_base.inverse() @ pose_map_base).is_within(self.rule.same_m):
                return observation
            self._missed[item.id] += observation.seen is False
        self._open[item.id] = _Visit(pose_map_base)
        return self._open[item.id]


def is_crossed(item: MapObject, path: KeyframeTrajectory, lens_m: float) -> bool:
    """Whether the base has been inside an object's footprint at any yaw of the object, by more than the standard
    deviation of their distance (both covariances).

    lens_m: height of the lens. False where the class is usually as high as the lens or higher, since a robot may pass
    under it, and for an object that a person has confirmed or corrected.
    """
    if item.label not in FIXTURES or HEIGHT_M[item.label][0] >= lens_m or item.confirmed or item.corrected:
        return False
    radius_m = min(footprint_m(item.label, item.width_m)) / 2.0
    x_m, y_m = (path.poses[:, :2] - item.position_m).T
    inside_m = radius_m - np.hypot(x_m, y_m)
    rows = np.flatnonzero(inside_m > 0.0)
    if not len(rows):
        return False
    angle_rad = np.arctan2(y_m[rows], x_m[rows])
    outwards = np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    both_m2 = item.covariance_m2 + path.covariances[rows, :2, :2]
    variance_m2 = np.einsum("ni,nij,nj->n", outwards, both_m2, outwards)
    return bool((np.square(inside_m[rows]) > variance_m2).any())
