"""From boxes to positions on the floor: which objects stand on it, their positions and covariances."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise, floor_covariances
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import WIDEST_M, Shape, extent_m, shape_of
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.feet import BoxOnFloor, box_ranges
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.occlusion import WORKTOP_LABELS, carried, covered
from edgemap.geometry.se2 import SE2

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

    def placed(self, pose_map_base: SE2, pose_covariance: Array, mount: Mount | None = None) -> "PlacedSighting":
        """This sighting in the map, seen from a pose whose 3x3 covariance (m, m, rad) is additive in the map frame.
        mount: the mount whose angles placed it, None where the attitude is measured in each frame."""
        rotation = pose_map_base.rotation()
        return PlacedSighting(
            self,
            pose_map_base.apply(self.position_base_m),
            rotation @ self.covariance_m2 @ rotation.T,
            rotation @ self.shared_m2 @ rotation.T,
            pose_map_base,
            pose_covariance,
            mount,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PlacedSighting:
    """A sighting in the map frame: position (2,), covariances (2, 2) of the sighting and of the mount, the pose of the
    observing robot with its covariance (3, 3). mount: the mount whose angles placed it, None where the attitude is
    measured in each frame.
    """

    sighting: Sighting
    position_map_m: Array
    covariance_m2: Array
    shared_m2: Array
    pose_map_base: SE2
    pose_covariance: Array
    mount: Mount | None = None

    @property
    def label(self) -> str:
        """Class name of the object."""
        return self.sighting.label

    def from_pose(self, pose_covariance: Array) -> Array:
        """Propagates a pose covariance (3, 3) to this object's position, (2, 2) m^2."""
        x_m, y_m = self.position_map_m - [self.pose_map_base.x_m, self.pose_map_base.y_m]
        wrt_pose = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m]])
        return wrt_pose @ pose_covariance @ wrt_pose.T


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


def _edge_px(camera: FloorCamera, rule: FloorRule) -> float:
    """Standard deviation of a box's edge by the size of the picture, px."""
    return rule.box.picture_share * max(camera.intrinsics.width, camera.intrinsics.height)


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
    sightings = []
    allowed = evidence.allowed(detections)
    for row, box, shared_m2 in _on_floor(detections, allowed, camera, rule, depth, floor):
        label, score, foot = detections.labels[row], float(detections.scores[row]), box.foot()
        width_m, height_m = box.width_m, box.height_m
        distance_m = float(np.linalg.norm(foot.position_m - box.lens_m))
        if box.is_out_of_sight or box.has_depth:
            nearer = float(box.direction @ (foot.position_m - box.lens_m)) / box.reach_m
            width_m, height_m = width_m * nearer, height_m * nearer + camera.mount.height_m * (1.0 - nearer)
        middle_m, covariance_m2 = box.shape.reach_m(width_m), foot.covariance_m2
        if box.cut:  # and with it, often, its nearest corner
            along_m = box.direction * box.shape.cut_sigma_m(box.width_m)
            covariance_m2 = covariance_m2 + np.outer(along_m, along_m)
        part, outline_m = box.is_hidden or box.cut, None
        if width_m > 0.0 and not part:
            x0, _, x1, y1 = detections.boxes[row] - 0.5  # pixel centres
            outline_m = np.vstack([box.lens_m, camera.floor_points([(x0, y1), (x1, y1)])])
        sightings.append(
            Sighting(
                label, score, foot.position_m + box.direction * middle_m, covariance_m2, shared_m2,
                width_m, height_m, box.extent_m, distance_m, row, frame, stamp_s,
                evidence.weight(score, label) * (PART_COUNTS if part else 1.0), outline_base_m=outline_m,
            )
        )  # fmt: skip
    return _without_doubles(sightings, detections.boxes)


def _on_floor(
    detections: Detections,
    allowed: NDArray[np.bool_],
    camera: FloorCamera,
    rule: FloorRule,
    depth: NDArray[np.float32] | None,
    floor: FloorMask | None,
) -> Iterator[tuple[int, BoxOnFloor, Array]]:
    """Boxes among the allowed ones (N,) whose lower edge is on the floor and that are not too wide for their class:
    row of each, the box, and the covariance (2, 2) of the edge by the mount.
    """
    feet = feet_px(detections)
    rows = np.flatnonzero(camera.below_horizon(feet) & allowed)
    if len(rows) == 0:
        return
    boxes, feet = detections.boxes[rows], feet[rows]
    low = boxes[:, 3] >= camera.intrinsics.height - 1 - _edge_px(camera, rule)  # cut by the picture's lower border
    px_per_m = camera.intrinsics.fx / camera.optical_depth_m(camera.floor_points(feet))
    sizes_px, labels = boxes[:, 2:] - boxes[:, :2], np.array(detections.labels)[rows].tolist()
    widths_m = (sizes_px[:, 0] / px_per_m).tolist()
    shapes = [shape_of(label, width_m) for label, width_m in zip(labels, widths_m, strict=True)]
    cover = np.array([covered(detections.boxes, int(row)) for row in rows])
    cut, across_px, sigmas_px = _edges(boxes, shapes, px_per_m, cover, camera, rule)
    feet = feet + np.column_stack([across_px, np.zeros(len(feet))])
    near = camera.floor_points(feet)
    random, shared = floor_covariances(camera, feet, sigmas_px, rule.noise)
    sizes_m = camera.optical_depth_m(near)[:, None] * sizes_px / [camera.intrinsics.fx, camera.intrinsics.fy]
    lens = camera.mount.position_base_m()[:2]
    bearings = near - lens
    reach_m = np.linalg.norm(bearings, axis=1)
    directions = bearings / np.maximum(reach_m, 1e-9)[:, None]
    (xx, xy), (_, yy) = np.moveaxis(random + shared, 0, -1)
    sigmas_m = np.sqrt((xx + yy) / 2.0 + np.hypot((xx - yy) / 2.0, xy))  # along the longer axis
    nearest_share = 1.0 - 2.0 * sigmas_m / np.maximum(reach_m, 1e-9)  # two deviations
    widest_m = np.array([WIDEST_M.get(label, math.inf) for label in labels])
    # Half a pixel from the horizon, or perhaps at it; or wider than anything of that label: it is something else.
    good = np.isfinite(random).all(axis=(1, 2)) & (nearest_share >= 0.0) & (sizes_m[:, 0] * nearest_share <= widest_m)
    ranges = np.full((len(boxes), 2), np.nan) if depth is None else box_ranges(depth, boxes, camera)
    for at in np.flatnonzero(good).tolist():
        far_m = float(reach_m[at])
        nearest_m = min(NEAREST_M, 0.5 * far_m) if low[at] else min(_floor_begins_m(boxes[at], camera, floor), far_m)
        width_m, height_m = sizes_m[at].tolist()
        box = BoxOnFloor(
            shapes[at], lens, near[at], random[at], directions[at], far_m, width_m, height_m,
            extent_m(labels[at], widths_m[at]), bool(cut[at]), float(cover[at]), nearest_m, *ranges[at].tolist(),
        )  # fmt: skip
        yield int(rows[at]), box, shared[at]


def _floor_begins_m(box: Array, camera: FloorCamera, floor: FloorMask | None) -> float:
    """Range from the lens at which floor begins below a box (4,) with none at its edge; infinite where it is at the
    edge, or without a mask."""
    row = None if floor is None else floor.hidden_until(box)
    if row is None:
        return math.inf
    (place_m,) = camera.floor_points([((box[0] + box[2]) / 2.0 - 0.5, row - 0.5)])
    return float(np.linalg.norm(place_m - camera.mount.position_base_m()[:2]))


def _edges(
    boxes: Array, shapes: list[Shape], px_per_m: Array, cover: Array, camera: FloorCamera, rule: FloorRule
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Which boxes the picture's sides cut (N,), how far across the true middle then is (N,), and the standard
    deviations (N, 2) of the lower edges' middles, across and down; px."""
    edge_px = _edge_px(camera, rule)
    sizes = boxes[:, 2:] - boxes[:, :2]
    left, right = boxes[:, 0] <= edge_px, boxes[:, 2] >= camera.intrinsics.width - edge_px
    widths_m = (sizes[:, 0] / px_per_m).tolist()
    missing_px = np.array([shape.missing_m(width) for shape, width in zip(shapes, widths_m, strict=True)]) * px_per_m
    across_px = np.where(left == right, 0.0, np.where(right, 0.5, -0.5) * missing_px)
    cut_px = np.array([shape.cut_sigma_m(width) for shape, width in zip(shapes, widths_m, strict=True)]) * px_per_m
    down_px = np.hypot(rule.box.down_share, rule.box.hidden_share * cover) * sizes[:, 1]
    sigmas_px = np.hypot(edge_px, np.column_stack([np.zeros(len(boxes)), down_px]))
    sigmas_px[:, 0] = np.hypot(sigmas_px[:, 0], np.where(left | right, cut_px, 0.0))
    return left | right, across_px, sigmas_px


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
