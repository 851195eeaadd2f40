"""The paper's equations 3 to 9, as written there and read with care; the product uses the general forms beside them.

All angles in radians, lengths in metres. The paper's map axes are (X, Z) = (-y, x) of REP-103.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]


def floor_distance_m(height_m: float, theta_h_rad: float, theta_o_rad: float) -> float:
    """Equation 3: Z = h / tan(theta_h - theta_o), the horizontal forward distance to a floor point.

    Angles of projection are measured upwards from the optical axis: theta_h to the horizon row h_t, theta_o to the
    box's lower edge. At pitch p (down) theta_h = p, so Z holds at any pitch, with zero roll. Infinite at the horizon.
    """
    difference = theta_h_rad - theta_o_rad
    return math.inf if difference <= 0.0 else height_m / math.tan(difference)


def projection_angle_rad(row_px: float, cy: float, fy: float) -> float:
    """Angle of projection of a picture row, positive above the optical axis: atan((cy - row) / fy)."""
    return math.atan2(cy - row_px, fy)


def lateral_offset_m(depth_m: float, column_px: float, cx: float, fx: float) -> float:
    """Equation 4 for position: depth * (x0 - xi) / f, positive left. Exact with depth along the optical axis."""
    return depth_m * (cx - column_px) / fx


def size_m(depth_m: float, side_px: float, focal_px: float) -> float:
    """Equation 4 for size: optical depth * box side / f."""
    return depth_m * side_px / focal_px


def map_change(motion: SE2) -> Array:
    """Equation 6: the 4x4 matrix that takes points of frame i into frame i+1, for points (x, y, 0, 1).

    It holds the INVERSE of the robot's motion from frame i to i+1.
    """
    change = motion.inverse()
    c, s = math.cos(change.yaw_rad), math.sin(change.yaw_rad)
    return np.array([[c, -s, 0.0, change.x_m], [s, c, 0.0, change.y_m], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def move_points(points_m: ArrayLike, motion: SE2) -> Array:
    """Equation 5: L_(i+1) = M . L_i for points (N, 2) of frame i, after the robot moved by `motion`."""
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    homogeneous = np.column_stack([points, np.zeros(len(points)), np.ones(len(points))])
    return (homogeneous @ map_change(motion).T)[:, :2]


def distance_m(a_m: ArrayLike, b_m: ArrayLike) -> float:
    """Equation 8 with the root that the paper leaves out: Euclidean distance."""
    return float(np.linalg.norm(np.asarray(a_m, dtype=np.float64) - np.asarray(b_m, dtype=np.float64)))


def paper_rmse(true_m: ArrayLike, estimated_m: ArrayLike) -> float:
    """Equation 9 over positions (N, 2): the root of the mean squared distance, common start, no alignment."""
    difference = np.asarray(true_m, dtype=np.float64) - np.asarray(estimated_m, dtype=np.float64)
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def xz_of(points_m: ArrayLike) -> Array:
    """REP-103 points (..., 2) in the paper's map axes (X, Z) = (-y, x)."""
    points = np.asarray(points_m, dtype=np.float64)
    return np.stack([-points[..., 1], points[..., 0]], axis=-1)
