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
class _Misses:
    """How often an object was missed since it was last detected. pose_map_base: of the current observation, which is
    all frames from about one place. shown: whether any of them shows the object, None where an object of its class was
    detected in its place."""

    count: int = 0
    pose_map_base: SE2 | None = None
    shown: bool | None = False

    def observe(self, pose_map_base: SE2, same_m: float) -> None:
        """A frame should show the object; an observation that ends by it is counted."""
        if self.pose_map_base is None or not (self.pose_map_base.inverse() @ pose_map_base).is_within(same_m):
            self.count += self.pose_map_base is not None and self.shown is False
            self.pose_map_base, self.shown = pose_map_base, False


class Forgetter:
    """Counts how often each object of the map was missed since it was last detected. missing: objects that would have
    left but are kept."""

    def __init__(self, camera: FloorCamera, rule: ForgetRule | None = None) -> None:
        self.camera, self.rule = camera, rule or ForgetRule()
        self.missing: set[str] = set()
        self._misses: defaultdict[str, _Misses] = defaultdict(_Misses)

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
        if not (objects := self._concerned(floor_map, pose_map_base, sighted)):
            return
        boxes = expected_boxes(objects, camera, pose_map_base)
        clear = in_plain_view(objects, boxes, camera, pose_map_base, detections, self.rule.view)
        if floor is not None:
            clear |= floor_in_place(objects, camera, pose_map_base, floor)
        labels = np.array(detections.labels, dtype=object)
        for item, box, is_clear in zip(objects, boxes, clear.tolist(), strict=True):
            if not is_clear and item.id not in sighted:
                continue
            missed = self._misses[item.id]
            if is_clear:
                missed.observe(pose_map_base, self.rule.same_m)
                if item.id in sighted:
                    missed.shown = True
                elif (
                    not missed.shown and (iou(box, detections.boxes[labels == item.label]) >= self.rule.same_iou).any()
                ):
                    missed.shown = None
            if item.id in sighted:  # it is present, whatever was missed before and in the same observation
                missed.count = 0
            if item.id in kept:
                floor_map.set_presence(item.id, 1.0)
                (self.missing.add if missed.count >= self.rule.misses else self.missing.discard)(item.id)
            elif missed.count >= self.rule.misses:
                floor_map.drop(item.id)
                del self._misses[item.id]
            else:
                floor_map.set_presence(item.id, 1.0 - missed.count / self.rule.misses)

    def _concerned(self, floor_map: FloorMap, pose_map_base: SE2, sighted: set[str]) -> list[MapObject]:
        """Objects near enough that are sighted or ahead; others cannot be in view."""
        objects = floor_map.near(np.array([pose_map_base.x_m, pose_map_base.y_m]), NEAR_M)
        places = pose_map_base.inverse().apply(np.reshape([item.position_m for item in objects], (-1, 2)))
        return [item for item, x_m in zip(objects, places[:, 0], strict=True) if x_m > 0.0 or item.id in sighted]


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
