"""From boxes to positions on the floor: which objects stand on it, their positions and covariances."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise, floor_covariances
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import WIDEST_M, Shapes, extent_m, shapes_of
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.feet import BoxesOnFloor, along_m, box_ranges
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.occlusion import WORKTOP_LABELS, carried, covered
from edgemap.geometry.se2 import SE2, by_pose

NEAREST_M = 0.2  # from the lens to the lower edge of anything: the robot itself is in between
DOUBLE_OVERLAP = 0.7  # share of the smaller box inside the other
WEIGHT_SPAN = 0.2  # of scores over which a sighting comes to count fully
PART_COUNTS = 0.5  # of a whole box: one that the picture or a nearer box cuts, when objects are made


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One object on the floor, seen in one frame.

    position_base_m: (2,) centre of the footprint, base frame. covariance_m2: (2, 2) of it from the box alone;
    shared_m2: (2, 2) from the mount, common to a whole drive. width_m, height_m: apparent size (eq. 4). extent_m: the
    longer side of its class's usual footprint.
    distance_m: horizontal, from the lens to the foot. detection: index into the frame's Detections. weight: 0..1, its
    evidence for a new object; low-confidence ones only update existing objects, as in ByteTrack (Zhang et al. 2022).
    pictures: number of 0.1 s intervals that it represents, so that evidence grows with time in view and not with the
    frame rate. outline_base_m: (3, 2) the lens and both ends of the box's lower edge on the floor; None where the
    picture or a nearer box cuts one of them.
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
    weight: float = 1.0
    pictures: float = 1.0
    outline_base_m: Array | None = None


@dataclass(frozen=True, eq=False)
class PlacedSighting:
    """A sighting in the map, seen from a pose whose covariance (3, 3) (m, m, rad) is additive in the map frame. mount:
    the mount whose angles placed it, None where the attitude is measured in each frame.
    """

    sighting: Sighting
    pose_map_base: SE2
    pose_covariance: Array
    mount: Mount | None = None

    @property
    def label(self) -> str:
        """Class name of the object."""
        return self.sighting.label

    @cached_property
    def position_map_m(self) -> Array:
        """Position (2,)."""
        return self.pose_map_base.apply(self.sighting.position_base_m)

    @cached_property
    def covariance_m2(self) -> Array:
        """Covariance (2, 2) from the box alone."""
        return self._turned(self.sighting.covariance_m2)

    def total_m2(self) -> Array:
        """Covariance (2, 2) with the errors of the mount and of the pose."""
        (wrt_pose,) = by_pose((self.position_map_m - self.pose_map_base.vector()[:2])[None])
        from_pose = wrt_pose @ self.pose_covariance @ wrt_pose.T
        return self.covariance_m2 + self._turned(self.sighting.shared_m2) + from_pose

    def _turned(self, covariance_m2: Array) -> Array:
        rotation = self.pose_map_base.rotation()
        return rotation @ covariance_m2 @ rotation.T


@dataclass(frozen=True, slots=True)
class BoxNoise:
    """Standard deviations of a box's edges."""

    # Of every edge, as a share of the picture's longer side (detectors scale it to their input size). An edge nearer
    # than that to the picture's border is cut off.
    picture_share: float = 0.004
    down_share: float = 0.02  # of the lower edge down, as a share of the box's height
    hidden_share: float = 0.12  # the same where nearer boxes cover all of it


@dataclass(frozen=True, slots=True)
class FloorRule:
    """When a box counts as an object on the floor."""

    noise: FloorNoise = field(default_factory=FloorNoise)
    box: BoxNoise = field(default_factory=BoxNoise)


@dataclass(frozen=True, slots=True)
class BoxEvidence:
    """Which boxes are evidence of an object, as the bundle and `--classes` state. mapped: labels that may be mapped;
    None means all. full_weight_score: at which a sighting counts half towards making an object; fully from 0.1 above it
    on, not at all from 0.1 below. class_scores: the same of single labels.
    """

    mapped: Collection[str] | None = None
    full_weight_score: float = 0.0
    class_scores: Mapping[str, float] = field(default_factory=dict)

    def weight(self, score: float, label: str = "") -> float:
        """Weight, 0..1, of a sighting of this score as evidence for an object."""
        half = self.class_scores.get(label, self.full_weight_score)
        return min(1.0, max(0.0, 0.5 + (score - half) / WEIGHT_SPAN))

    def allowed(self, detections: Detections) -> NDArray[np.bool_]:
        """Which boxes may be mapped at all, (N,)."""
        mapped = np.array([self.mapped is None or label in self.mapped for label in detections.labels], dtype=bool)
        return mapped & ~carried(detections)


EVERY_BOX = BoxEvidence()


def feet_px(detections: Detections) -> Array:
    """Middle of each box's lower edge as the lens counts pixels, from their centres, (N, 2) px."""
    boxes = detections.boxes
    return np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2.0, boxes[:, 3]]) - 0.5


def is_worktop(mask: FloorMask | None, detections: Detections) -> bool:
    """Whether a floor mask takes a worktop for floor: it is floor at the foot of an object of `WORKTOP_LABELS`."""
    small = [label in WORKTOP_LABELS for label in detections.labels]
    return mask is not None and any(small) and bool((mask.at(feet_px(detections)[small]) >= 0.5).any())


def sightings_of(
    detections: Detections,
    camera: FloorCamera,
    rule: FloorRule,
    frame: int = 0,
    stamp_s: float = 0.0,
    depth: NDArray[np.float32] | None = None,
    floor: FloorMask | None = None,
    evidence: BoxEvidence = EVERY_BOX,
) -> list[Sighting]:
    """Every box that stands on the floor, projected there: footprint centre, covariance and size. The one floor rule.

    A box stands on the floor if its lower edge is below the horizon row h_t, its label is mapped, it is not a tabletop
    object on furniture (paper, section 3.5), it is near enough, not part of another box, and not wider than its class
    allows.
    Where the picture's side cuts a box, its class's usual width gives its middle; where nearer boxes cover its lower
    edge, that width gives a coarse range. Where no floor is seen below the edge, something hides the foot: it stands
    between there and the edge; where the picture ends above the foot, between the robot and the nearest floor in view.
    depth: (H, W) metres, where the camera has it: the range of the object in a box is another measurement of its
    position. floor: the picture's floor mask, where the network predicts one.
    """
    rows = np.flatnonzero(camera.below_horizon(feet_px(detections)) & evidence.allowed(detections))
    if not len(rows):
        return []
    boxes = _on_floor(detections, rows, camera, rule, depth, floor)
    lens_m, shapes, part = camera.mount.position_base_m()[:2], Shapes(*boxes.shapes.T), boxes.hidden | boxes.cut
    feet_m, covariances_m2 = boxes.feet(lens_m)
    offsets_m = feet_m - lens_m
    distances_m = np.sqrt(along_m(offsets_m, offsets_m))
    nearer = along_m(boxes.directions, offsets_m) / boxes.reach_m  # than the edge, as a share
    nearer = np.where(boxes.out_of_sight | boxes.has_depth, nearer, 1.0)
    widths_m = boxes.sizes_m[:, 0] * nearer
    heights_m = boxes.sizes_m[:, 1] * nearer + camera.mount.height_m * (1.0 - nearer)
    positions_m = feet_m + boxes.directions * shapes.reach_m(widths_m)[:, None]
    if boxes.cut.any():  # and with its side, often, its nearest corner
        sides_m = boxes.directions * np.where(boxes.cut, shapes.cut_sigma_m(boxes.sizes_m[:, 0]), 0.0)[:, None]
        covariances_m2 = covariances_m2 + sides_m[:, :, None] * sides_m[:, None]
    sightings, labels = [], detections.labels
    for at, row in enumerate(boxes.rows.tolist()):
        label, score = labels[row], float(detections.scores[row])
        outline_m = None
        if widths_m[at] > 0.0 and not part[at]:
            x0, _, x1, y1 = detections.boxes[row] - 0.5  # pixel centres
            outline_m = np.vstack([lens_m, camera.floor_points([(x0, y1), (x1, y1)])])
        sightings.append(
            Sighting(
                label, score, positions_m[at], covariances_m2[at], boxes.shared_m2[at],
                float(widths_m[at]), float(heights_m[at]), float(boxes.extents_m[at]), float(distances_m[at]),
                row, frame, stamp_s, evidence.weight(score, label) * (PART_COUNTS if part[at] else 1.0),
                outline_base_m=outline_m,
            )
        )  # fmt: skip
    return _without_doubles(sightings, detections.boxes)


def _on_floor(
    detections: Detections,
    rows: NDArray[np.intp],
    camera: FloorCamera,
    rule: FloorRule,
    depth: NDArray[np.float32] | None,
    floor: FloorMask | None,
) -> BoxesOnFloor:
    """Those of the boxes of these rows, one at least, below the horizon, that are on the floor, and not too wide for
    their class."""
    boxes, feet, lens = detections.boxes[rows], feet_px(detections)[rows], camera.intrinsics
    labels, sizes_px = [detections.names[kind] for kind in detections.class_ids[rows]], boxes[:, 2:] - boxes[:, :2]
    px_per_m = lens.fx / camera.optical_depth_m(camera.floor_points(feet))
    widths_m = sizes_px[:, 0] / px_per_m
    shapes = shapes_of(labels, widths_m)
    cover = np.array([covered(detections.boxes, row) for row in rows.tolist()])
    # Which sides the picture cuts, how far across the true middle then is, and how sure that of the lower edge is.
    edge_px = rule.box.picture_share * max(lens.width, lens.height)
    left, right = boxes[:, 0] <= edge_px, boxes[:, 2] >= lens.width - edge_px
    cut, low = left | right, boxes[:, 3] >= lens.height - 1 - edge_px
    across_px = np.where(left == right, 0.0, np.where(right, 0.5, -0.5) * (shapes.missing_m(widths_m) * px_per_m))
    cut_px = np.where(cut, shapes.cut_sigma_m(widths_m) * px_per_m, 0.0)
    down_px = np.hypot(rule.box.down_share, rule.box.hidden_share * cover) * sizes_px[:, 1]
    middles = feet + across_px[:, None] * [1.0, 0.0]
    random, shared = floor_covariances(
        camera, middles, np.hypot(edge_px, np.column_stack([cut_px, down_px])), rule.noise
    )
    near, lens_m = camera.floor_points(middles), camera.mount.position_base_m()[:2]
    sizes_m = camera.optical_depth_m(near)[:, None] * sizes_px / [lens.fx, lens.fy]
    reach_m = np.linalg.norm(near - lens_m, axis=1)
    directions = (near - lens_m) / np.maximum(reach_m, 1e-9)[:, None]
    begins_m = np.array([_floor_begins_m(box, camera, floor) for box in boxes])
    (xx, xy), (_, yy) = np.moveaxis(random + shared, 0, -1)
    sigmas_m = np.sqrt((xx + yy) / 2.0 + np.hypot((xx - yy) / 2.0, xy))  # along the longer axis
    nearest_share = 1.0 - 2.0 * sigmas_m / np.maximum(reach_m, 1e-9)  # two deviations
    widest_m = np.array([WIDEST_M.get(label, math.inf) for label in labels])
    # Half a pixel from the horizon, or perhaps at it; or wider than anything of that label: it is something else.
    good = np.isfinite(random).all(axis=(1, 2)) & (nearest_share >= 0.0) & (sizes_m[:, 0] * nearest_share <= widest_m)
    found = BoxesOnFloor(
        rows, np.transpose(shapes), np.array([extent_m(*one) for one in zip(labels, widths_m, strict=True)]),
        near, random, shared, directions, reach_m, sizes_m, cut, cover,
        np.where(low, np.minimum(NEAREST_M, 0.5 * reach_m), np.minimum(begins_m, reach_m)),
        box_ranges(depth, boxes, camera),
    )  # fmt: skip
    return found if good.all() else BoxesOnFloor._make(values[good] for values in found)


def _floor_begins_m(box: Array, camera: FloorCamera, floor: FloorMask | None) -> float:
    """Range from the lens at which floor begins below a box (4,) with none at its edge; infinite where it is at the
    edge, or without a mask."""
    row = None if floor is None else floor.hidden_until(box)
    if row is None:
        return math.inf
    (place_m,) = camera.floor_points([((box[0] + box[2]) / 2.0 - 0.5, row - 0.5)])
    return float(np.linalg.norm(place_m - camera.mount.position_base_m()[:2]))


def _without_doubles(sightings: list[Sighting], boxes: Array) -> list[Sighting]:
    """Drops a box that lies mostly inside a higher-scoring one of its label and stands where that one stands.

    Suppression by IoU keeps a box round a part of an object in addition to the box round all of it.
    """
    kept: list[Sighting] = []
    for sighting in sorted(sightings, key=lambda s: -s.score):
        if not any(
            other.label == sighting.label
            and np.linalg.norm(other.position_base_m - sighting.position_base_m) < 0.5 * sighting.extent_m
            and _overlap(boxes[other.detection], boxes[sighting.detection])
            for other in kept
        ):
            kept.append(sighting)
    return kept


def _overlap(a: Array, b: Array) -> bool:
    """Whether the smaller of two boxes lies mostly inside the other; one without area does not."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    smaller = min(np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2]))
    return bool(np.prod(np.maximum(sides, 0.0)) > DOUBLE_OVERLAP * smaller)
