"""Positions of boxes' feet on the floor: by their lower edges, by their classes' usual width, by depth."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import NEAREST_M
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.class_extents import Shapes

SURFACE_SHARE = 0.5  # of the way to its middle, give or take as much: how far behind its lower edge an object is seen
HIDDEN = 0.5  # share of a lower edge covered by nearer boxes, from which on it may well be hidden
FARTHEST_M = 8.0
OFF_FLOOR_M, OFF_FLOOR_PER_M = 0.05, 0.01  # lower points are the floor's
KNOWN_SHARE = 0.25  # of the samples, above the floor and with measured depth
NEAR_QUANTILE = 0.3  # what shows through an object lies behind it
DEPTH_M, DEPTH_PER_M2 = 0.02, 0.004  # standard deviation of a measured range: constant, and with its square


class BoxesOnFloor(NamedTuple):
    """Boxes whose lower edges the camera projects to the floor, (N,) of each unless stated.

    rows: of the detections. shapes (N, 4): usual ones, `Shapes`. extents_m: the longer side of their classes' usual
    footprint. edges_m (N, 2), edges_m2 (N, 2, 2): the middles of the lower edges there, base frame, and covariances by
    the box; shared_m2 (N, 2, 2): those by the mount. directions (N, 2), reach_m: from the lens to them. sizes_m (N, 2):
    apparent width and height there (the paper's eq. 4). cut: by the picture's left or right border. cover: share of the
    lower edge that nearer boxes cover. nearest_m: the nearest range at which the foot may be: `reach_m` where floor
    begins below the edge, less where something stands before it or the picture ends. ranges_m (N, 2): by depth, as
    `box_ranges` returns them.
    """

    rows: NDArray[np.intp]
    shapes: Array
    extents_m: Array
    edges_m: Array
    edges_m2: Array
    shared_m2: Array
    directions: Array
    reach_m: Array
    sizes_m: Array
    cut: NDArray[np.bool_]
    cover: Array
    nearest_m: Array
    ranges_m: Array

    @property
    def out_of_sight(self) -> NDArray[np.bool_]:
        """Whether the foot itself is not in view."""
        return self.nearest_m < self.reach_m

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """Whether the foot of the object may be another place than the lower edge shows."""
        return self.out_of_sight | (self.cover > HIDDEN)

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Whether depth shows the object."""
        return np.isfinite(self.ranges_m[:, 1])

    def feet(self, lens_m: Array) -> tuple[Array, Array]:
        """The feet by all that applies: positions (N, 2), base frame, and covariances (N, 2, 2). lens_m: (2,)."""
        shapes, widths_m, reach_m = Shapes(*self.shapes.T), self.sizes_m[:, 0], self.reach_m
        feet, hidden = (self.edges_m, self.edges_m2), self.hidden
        if hidden.any():
            # Something nearer hides it, or the picture ends above it: it is anywhere from `nearest_m` to the edge.
            range_m, sigma_m = (reach_m + self.nearest_m) / 2.0, (reach_m - self.nearest_m) / math.sqrt(12.0)
            along = self.directions[:, :, None] * self.directions[:, None]
            across = np.eye(2) - along
            scale2, sigma2 = ((values**2)[:, None, None] for values in (range_m / reach_m, sigma_m))
            positions_m = self.edges_m + self.directions * (range_m - reach_m)[:, None]
            covariances_m2 = across @ self.edges_m2 @ across * scale2 + along * sigma2
            feet = positions_m, np.where(self.out_of_sight[:, None, None], covariances_m2, self.edges_m2)
            # The object is as wide as its class usually is, so its apparent width shows its range.
            usual_m = reach_m * shapes.width / np.maximum(widths_m, 1e-9)
            usual_sigma_m = np.where(hidden & ~self.cut, usual_m * shapes.width_sigma / shapes.width, math.inf)
            feet = _ranged(*feet, self.directions, usual_m - range_m, usual_sigma_m)
        if self.has_depth.any():  # a surface some way behind the foot
            behind_m, (measured_m, measured_sigma_m) = shapes.reach_m(widths_m) * SURFACE_SHARE, self.ranges_m.T
            error_m = measured_m - behind_m - along_m(self.directions, feet[0] - lens_m)
            feet = _ranged(*feet, self.directions, error_m, np.hypot(measured_sigma_m, behind_m))
        return feet


def along_m(directions: Array, offsets_m: Array) -> Array:
    """Lengths (N,) of offsets (N, 2) along directions (N, 2)."""
    return (directions[:, None] @ offsets_m[:, :, None])[:, 0, 0]


def _ranged(
    positions_m: Array, covariances_m2: Array, directions: Array, errors_m: Array, sigmas_m: Array
) -> tuple[Array, Array]:
    """Feet after measured ranges: Kalman's update with one scalar each.

    errors_m (N,): measured ranges less those of the feet, along the directions; sigmas_m (N,): their standard
    deviations, infinite where nothing was measured.
    """
    rays = directions[:, :, None]
    seen = covariances_m2 @ rays
    gains = seen / (directions[:, None] @ covariances_m2 @ rays + sigmas_m[:, None, None] ** 2)
    return positions_m + gains[:, :, 0] * errors_m[:, None], covariances_m2 - gains * seen.transpose(0, 2, 1)


def box_ranges(depth: NDArray[np.float32] | None, boxes: Array, camera: FloorCamera) -> Array:
    """Horizontal range from the lens to the object in each box, and its standard deviation, (N, 2) m; 0 and infinity
    where unknown.

    depth: (H, W) metres along the optical axis, 0 or NaN where unknown; None without depth. boxes: (N, 4), as of
    `Detections`, one at least.
    """
    ranges = np.tile([0.0, math.inf], (len(boxes), 1))
    if depth is None:
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
