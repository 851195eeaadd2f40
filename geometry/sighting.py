"""From boxes to places on the floor: which objects stand on it, where, and how surely."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.detections import Detections
from edgemap.geometry.floor import FloorCamera, FloorNoise, floor_covariances
from edgemap.geometry.paper import size_m
from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]

# Usual footprint of a class, width and depth in metres; where none is known, the box's own width serves for both.
FOOTPRINT_M = {
    "chair": (0.50, 0.50), "couch": (2.00, 0.90), "potted plant": (0.40, 0.40), "bed": (1.60, 2.00),
    "dining table": (1.40, 0.90), "toilet": (0.40, 0.65), "tv": (1.00, 0.25), "refrigerator": (0.65, 0.65),
    "oven": (0.60, 0.60), "sink": (0.60, 0.50), "bench": (1.40, 0.50), "suitcase": (0.45, 0.30),
    "backpack": (0.35, 0.25), "vase": (0.20, 0.20), "bicycle": (1.70, 0.50), "motorcycle": (2.00, 0.80),
    "car": (4.20, 1.80), "truck": (7.00, 2.50), "bus": (11.00, 2.60),
}  # fmt: skip
WIDEST_UNKNOWN_M = 1.0
DOUBLE_OVERLAP = 0.7  # share of the smaller box inside the other

# What people put on furniture; on the floor only where no furniture is seen under it.
TABLETOP_LABELS = frozenset(
    {"vase", "potted plant", "tv", "laptop", "book", "bottle", "wine glass", "cup", "bowl", "clock", "microwave",
     "toaster", "teddy bear", "keyboard", "mouse", "remote", "cell phone", "fork", "knife", "spoon", "scissors",
     "hair drier", "toothbrush", "banana", "apple", "sandwich", "orange", "broccoli", "carrot", "hot dog", "pizza",
     "donut", "cake", "sink", "backpack", "handbag"}
)  # fmt: skip
SUPPORT_LABELS = frozenset({"dining table", "couch", "bed", "bench", "oven", "refrigerator", "chair", "sink"})


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One object on the floor, seen in one frame.

    position_base_m: (2,) centre of the footprint, base frame. covariance_m2: (2, 2) of it from pixel noise;
    shared_m2: (2, 2) from the mount, common to a whole drive. width_m, height_m: apparent size (eq. 4). extent_m: the
    longer side of its class's usual footprint.
    distance_m: horizontal, from the lens. detection: index into the frame's Detections.
    """

    label: str
    score: float
    position_base_m: Array
    covariance_m2: Array
    shared_m2: Array
    width_m: float
    height_m: float
    extent_m: float
    distance_m: float
    detection: int
    frame: int = 0
    stamp_s: float = 0.0

    def placed(self, pose_map_base: SE2, pose_covariance: Array) -> PlacedSighting:
        """This sighting in the map, seen from a pose whose 3x3 covariance (m, m, rad) is additive in the map frame."""
        rotation = pose_map_base.rotation()
        position = pose_map_base.apply(self.position_base_m)
        return PlacedSighting(
            sighting=self,
            position_map_m=position,
            covariance_m2=rotation @ self.covariance_m2 @ rotation.T,
            shared_m2=rotation @ self.shared_m2 @ rotation.T,
            lever_m=position - [pose_map_base.x_m, pose_map_base.y_m],
            pose_covariance=pose_covariance,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PlacedSighting:
    """A sighting in the map frame. lever_m: (2,) from the robot to the object, how yaw errors reach it."""

    sighting: Sighting
    position_map_m: Array
    covariance_m2: Array
    shared_m2: Array
    lever_m: Array
    pose_covariance: Array

    @property
    def label(self) -> str:
        """Class name of the object."""
        return self.sighting.label

    def from_pose(self, pose_covariance: Array) -> Array:
        """What a pose covariance (3, 3) means for this object's position, (2, 2) m^2."""
        wrt_pose = np.array([[1.0, 0.0, -self.lever_m[1]], [0.0, 1.0, self.lever_m[0]]])
        return wrt_pose @ pose_covariance @ wrt_pose.T


@dataclass(frozen=True, slots=True)
class BoxNoise:
    """Standard deviations of a box against the object's footprint.

    picture_share: of every edge, as a share of the picture's longer side (detectors see it at their own size).
    across_share, down_share: of the lower edge's middle across, and of the lower edge down, as a share of the box's
    width and height. cut_share: across, of the width, where the box is cut by the picture's side. footprint_share: of
    the footprint's centre, as a share of the footprint's longer side, whatever the picture says.
    """

    picture_share: float = 0.004
    across_share: float = 0.06
    down_share: float = 0.02
    cut_share: float = 0.3
    footprint_share: float = 0.15


@dataclass(frozen=True, slots=True)
class FloorRule:
    """When a box counts as an object on the floor, and how far it is believed.

    border_px: a lower edge this near the picture's lower border is cut off. max_sigma_m: sightings less certain than
    this (largest standard deviation, pixel and mount together) are dropped. max_distance_m: and those farther.
    mapped: labels that may be mapped; None means all.
    """

    border_px: float = 3.0
    max_sigma_m: float = 0.75
    max_distance_m: float = 15.0
    noise: FloorNoise = field(default_factory=FloorNoise)
    box: BoxNoise = field(default_factory=BoxNoise)
    mapped: Collection[str] | None = None


def on_floor(detections: Detections, camera: FloorCamera, rule: FloorRule) -> NDArray[np.bool_]:
    """Which boxes stand on the floor, (N,): lower edge below the horizon row h_t, not cut by the lower border,
    a label that is mapped, and no tabletop object that is seen standing on furniture (paper, section 3.5)."""
    feet = feet_px(detections)
    below = camera.below_horizon(feet)
    whole = detections.boxes[:, 3] < camera.intrinsics.height - 1 - rule.border_px
    labels = detections.labels
    allowed = np.array([rule.mapped is None or label in rule.mapped for label in labels], dtype=bool)
    carried = np.array([_is_carried(i, detections, labels) for i in range(len(detections))], dtype=bool)
    return below & whole & allowed & ~carried


def feet_px(detections: Detections) -> Array:
    """Middle of each box's lower edge as the lens counts pixels, from their centres, (N, 2) px."""
    boxes = detections.boxes
    return np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2.0, boxes[:, 3]]) - 0.5


def sightings_of(
    detections: Detections, camera: FloorCamera, rule: FloorRule, frame: int = 0, stamp_s: float = 0.0
) -> list[Sighting]:
    """Every box that stands on the floor, projected there: footprint centre, covariance and size."""
    standing = np.flatnonzero(on_floor(detections, camera, rule))
    if len(standing) == 0:
        return []
    feet = feet_px(detections)[standing]
    near = camera.floor_points(feet)
    own, shared = floor_covariances(camera, feet, _sigmas_px(detections.boxes[standing], camera, rule), rule.noise)
    depth = camera.optical_depth_m(near)
    lens = camera.mount.position_base_m()[:2]
    labels, sightings = detections.labels, []
    for row, index in enumerate(standing):
        label = labels[index]
        x0, y0, x1, y1 = detections.boxes[index]
        width_m = size_m(float(depth[row]), x1 - x0, camera.intrinsics.fx)
        height_m = size_m(float(depth[row]), y1 - y0, camera.intrinsics.fy)
        if not np.isfinite(own[row]).all():  # half a pixel from the horizon
            continue
        bearing = near[row] - lens
        reach = float(np.linalg.norm(bearing))
        unknown = min(width_m, WIDEST_UNKNOWN_M)
        footprint = FOOTPRINT_M.get(label, (unknown, unknown))
        half_depth = footprint[1] / 2.0
        direction = bearing / max(reach, 1e-9)
        sigma_m = math.sqrt(float(np.linalg.eigvalsh(own[row] + shared[row])[-1]))
        guessed = np.outer(direction, direction) * (0.5 * half_depth) ** 2  # depth is not seen
        guessed += np.eye(2) * (rule.box.footprint_share * max(footprint)) ** 2
        if sigma_m > rule.max_sigma_m or reach > rule.max_distance_m:
            continue
        sightings.append(
            Sighting(
                label, float(detections.scores[index]), near[row] + direction * half_depth, own[row] + guessed,
                shared[row], width_m, height_m, max(footprint), reach, int(index), frame, stamp_s,
            )
        )  # fmt: skip
    return _without_doubles(sightings, detections.boxes)


def _without_doubles(sightings: list[Sighting], boxes: Array) -> list[Sighting]:
    """Drop a box that lies mostly inside a stronger one of its label and stands where that one stands.

    Suppression by IoU keeps a box round a part of an object beside the box round all of it.
    """
    kept: list[Sighting] = []
    for sighting in sorted(sightings, key=lambda s: -s.score):
        for other in kept:
            near_m = 0.5 * sighting.extent_m
            if (
                other.label == sighting.label
                and np.linalg.norm(other.position_base_m - sighting.position_base_m) < near_m
                and _overlap_of_smaller(boxes[other.detection], boxes[sighting.detection]) > DOUBLE_OVERLAP
            ):
                break
        else:
            kept.append(sighting)
    return kept


def _overlap_of_smaller(a: Array, b: Array) -> float:
    """Intersection of two boxes as a share of the smaller one."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return float(np.prod(np.maximum(sides, 0.0)) / min(np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2])))


def _sigmas_px(boxes: Array, camera: FloorCamera, rule: FloorRule) -> Array:
    """Standard deviations (N, 2) of the lower edges' middles, across and down, px."""
    longer = max(camera.intrinsics.width, camera.intrinsics.height)
    sizes = boxes[:, 2:] - boxes[:, :2]
    cut = (boxes[:, 0] <= rule.border_px) | (boxes[:, 2] >= camera.intrinsics.width - rule.border_px)
    shares = np.column_stack(
        [np.where(cut, rule.box.cut_share, rule.box.across_share), np.full(len(boxes), rule.box.down_share)]
    )
    return np.hypot(rule.box.picture_share * longer, shares * sizes)


def _is_carried(index: int, detections: Detections, labels: list[str]) -> bool:
    """A tabletop object whose lower edge lies inside a piece of furniture's box, well above that one's own feet."""
    if labels[index] not in TABLETOP_LABELS:
        return False
    x0, _, x1, y1 = detections.boxes[index]
    middle = (x0 + x1) / 2.0
    for other, label in enumerate(labels):
        if other == index or label not in SUPPORT_LABELS or label == labels[index]:
            continue
        sx0, sy0, sx1, sy1 = detections.boxes[other]
        if sx0 <= middle <= sx1 and sy0 <= y1 <= sy1 - 0.15 * (sy1 - sy0) and (sx1 - sx0) > (x1 - x0):
            return True
    return False
