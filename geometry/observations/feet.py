"""Position of a box's foot on the floor: by its lower edge, by its class's usual width, by depth.

Each model takes a box and the foot that the models before it have placed, and gives the foot with what it measures.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import NEAREST_M
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.class_extents import Shape

SURFACE_SHARE = 0.5  # of the way to its middle, give or take as much: how far behind its lower edge an object is seen
HIDDEN = 0.5  # share of a lower edge covered by nearer boxes, from which on it may well be hidden
FARTHEST_M = 8.0
OFF_FLOOR_M, OFF_FLOOR_PER_M = 0.05, 0.01  # lower points are the floor's
KNOWN_SHARE = 0.25  # of the samples, above the floor and with measured depth
NEAR_QUANTILE = 0.3  # what shows through an object lies behind it
DEPTH_M, DEPTH_PER_M2 = 0.02, 0.004  # standard deviation of a measured range: constant, and with its square


@dataclass(frozen=True, slots=True, eq=False)
class Foot:
    """position_m (2,), covariance_m2 (2, 2): of the middle of a lower edge on the floor, base frame. range_m: from the
    lens, by the lower edge alone."""

    position_m: Array
    covariance_m2: Array
    range_m: float


@dataclass(frozen=True, slots=True, eq=False)
class BoxOnFloor:
    """A box whose lower edge the camera projects to the floor.

    lens_m, edge_m (2,), edge_m2 (2, 2): the lens and that projection, base frame; direction (2,), reach_m: from the one
    to the other. width_m, height_m: apparent, there (the paper's eq. 4). extent_m: the longer side of its class's usual
    footprint. cut: by the picture's left or right border. cover: share of the lower edge that nearer boxes cover.
    nearest_m: the nearest range at which its foot may be: `reach_m` where floor begins below the edge, less where
    something stands before it or the picture ends. measured_m, measured_sigma_m: range of what the box shows by depth;
    NaN where there is none.
    """

    shape: Shape
    lens_m: Array
    edge_m: Array
    edge_m2: Array
    direction: Array
    reach_m: float
    width_m: float
    height_m: float
    extent_m: float
    cut: bool
    cover: float
    nearest_m: float
    measured_m: float
    measured_sigma_m: float

    @property
    def is_out_of_sight(self) -> bool:
        """Whether the foot itself is not in view."""
        return self.nearest_m < self.reach_m

    @property
    def is_hidden(self) -> bool:
        """Whether the foot of the object may be another place than the lower edge shows."""
        return self.is_out_of_sight or self.cover > HIDDEN

    @property
    def has_depth(self) -> bool:
        """Whether depth shows the object."""
        return bool(np.isfinite(self.measured_m))

    def foot(self) -> Foot:
        """The foot by all models that apply."""
        foot = Foot(self.edge_m, self.edge_m2, self.reach_m)
        if self.is_out_of_sight:
            foot = behind_cover(self, foot)
        if self.is_hidden and not self.cut:
            foot = by_usual_width(self, foot)
        return by_depth(self, foot) if self.has_depth else foot


def behind_cover(box: BoxOnFloor, foot: Foot) -> Foot:
    """Something nearer hides the foot, or the picture ends above it: the foot is anywhere between `nearest_m` and the
    edge."""
    range_m, sigma_m = (box.reach_m + box.nearest_m) / 2.0, (box.reach_m - box.nearest_m) / math.sqrt(12.0)
    share, direction = range_m / box.reach_m, box.direction
    along = np.outer(direction, direction)
    across = np.eye(2) - along
    covariance_m2 = across @ foot.covariance_m2 @ across * share**2 + along * sigma_m**2
    return Foot(foot.position_m + direction * (range_m - box.reach_m), covariance_m2, range_m)


def by_usual_width(box: BoxOnFloor, foot: Foot) -> Foot:
    """The object is as wide as its class usually is, so its apparent width shows its range."""
    usual_m = box.reach_m * box.shape.width / max(box.width_m, 1e-9)
    return _ranged(foot, box.direction, usual_m - foot.range_m, usual_m * box.shape.width_sigma / box.shape.width)


def by_depth(box: BoxOnFloor, foot: Foot) -> Foot:
    """Depth shows a surface some way behind the foot."""
    behind_m = box.shape.reach_m(box.width_m) * SURFACE_SHARE
    error_m = box.measured_m - behind_m - float(box.direction @ (foot.position_m - box.lens_m))
    return _ranged(foot, box.direction, error_m, math.hypot(box.measured_sigma_m, behind_m))


def _ranged(foot: Foot, direction: Array, error_m: float, sigma_m: float) -> Foot:
    """A foot after a measured range: Kalman's update with one scalar.

    error_m: measured range less that of the foot, along the direction (2,); sigma_m: its standard deviation.
    """
    covariance_m2 = foot.covariance_m2
    gain = covariance_m2 @ direction / (direction @ covariance_m2 @ direction + sigma_m**2)
    position_m = foot.position_m + gain * error_m
    return Foot(position_m, covariance_m2 - np.outer(gain, covariance_m2 @ direction), foot.range_m)


def box_ranges(depth: NDArray[np.float32], boxes: Array, camera: FloorCamera) -> Array:
    """Horizontal range from the lens to the object in each box, and its standard deviation, (N, 2) m; NaN where
    unknown.

    depth: (H, W) metres along the optical axis, 0 or NaN where unknown. boxes: (N, 4), as of `Detections`.
    """
    ranges = np.full((len(boxes), 2), np.nan)
    if len(boxes) == 0:
        return ranges
    size = np.array([camera.intrinsics.width, camera.intrinsics.height], dtype=np.float64)
    low, high = np.clip(boxes[:, :2], 0.0, size), np.clip(boxes[:, 2:], 0.0, size)
    across, down = np.linspace(0.2, 0.8, 14), np.linspace(0.15, 0.9, 14)  # of a box, where it is read
    u = low[:, :1] + (high - low)[:, :1] * across
    v = low[:, 1:] + (high - low)[:, 1:] * down
    columns = np.clip(u.astype(np.intp), 0, camera.intrinsics.width - 1)
    rows = np.clip(v.astype(np.intp), 0, camera.intrinsics.height - 1)
    z = depth[rows[:, :, None], columns[:, None, :]].astype(np.float64).reshape(len(boxes), -1)
    pixels = np.stack(np.broadcast_arrays(columns[:, None, :], rows[:, :, None]), axis=-1).reshape(-1, 2)
    rays = camera.intrinsics.rays(pixels.astype(np.float64))
    along = (rays / rays[:, 2:]) @ camera.mount.rotation_base_optical().T
    points = along.reshape(len(boxes), -1, 3) * z[..., None]
    reach = np.hypot(points[..., 0], points[..., 1])
    heights = points[..., 2] + camera.mount.height_m
    measured = (z > NEAREST_M) & (z < FARTHEST_M) & (heights > OFF_FLOOR_M + OFF_FLOOR_PER_M * reach)
    for row in np.flatnonzero(measured.mean(axis=1) > KNOWN_SHARE):
        near_m = float(np.quantile(reach[row, measured[row]], NEAR_QUANTILE))
        ranges[row] = near_m, DEPTH_M + DEPTH_PER_M2 * near_m**2
    return ranges
