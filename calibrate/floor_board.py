"""The mount from pictures of a chessboard on the floor: height, pitch and roll."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares

from edgemap.calibrate.board import Board, BoardView
from edgemap.calibrate.floor_depth import WORST_HEIGHT_SHARE, WORST_TILT_RAD
from edgemap.calibrate.lens import WORST_RMS_PX
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, pitch_roll
from edgemap.geometry.errors import GeometryError
from edgemap.geometry.robust import FEWEST
from edgemap.runtime.frames.errors import CalibrationError


@dataclass(frozen=True, slots=True)
class MountFit:
    """The fitted mount. sigma: one standard deviation of height_m, pitch_rad, roll_rad."""

    mount: Mount
    rms_px: float
    worst_view_px: float
    sigma: tuple[float, float, float]
    views: int

    def record(self) -> dict[str, Any]:
        """For camera.yaml's `calibration`."""
        return {
            "method": "chessboard on the floor",
            "views": self.views,
            "rms_px": round(self.rms_px, 4),
            "worst_view_px": round(self.worst_view_px, 4),
            "sigma_height_m": round(self.sigma[0], 5),
            "sigma_pitch_deg": round(math.degrees(self.sigma[1]), 4),
            "sigma_roll_deg": round(math.degrees(self.sigma[2]), 4),
        }


def fit_mount(views: list[BoardView], board: Board, lens: Intrinsics, thickness_m: float = 0.0) -> MountFit:
    """One mount that explains all views: boards lie on one floor, each at its own place and heading.

    Started from each view's own pose (planar PnP), then all corners at once by least squares on pixels. thickness_m: of
    the board. The lever arm is left at zero. Raises CalibrationError with the numbers for too few views and bad fits.
    """
    if len(views) < FEWEST:
        raise CalibrationError(
            f"{len(views)} different views of the complete board found, need {FEWEST} or more: put it on other "
            "places of the floor (is --board its number of INNER corners?)"
        )
    starts = [_pose_of(view, board, lens) for view in views]
    ups = np.array([up for up, _ in starts])
    pitch_rad, roll_rad = pitch_roll(np.median(ups, axis=0))
    height_m = float(np.median([height for _, height in starts]))
    places = [_place(view, board, lens, height_m, pitch_rad, roll_rad) for view in views]
    start = np.concatenate([[height_m, pitch_rad, roll_rad], *places])
    observed = np.array([view.corners_px for view in views])

    def residuals(values: Array) -> Array:
        try:
            pixels = _project(values, board, lens)
        except GeometryError:
            return np.full(observed.size, 1e3)
        return np.nan_to_num(pixels - observed, nan=1e3).ravel()

    fit = least_squares(residuals, start, loss="soft_l1", x_scale="jac")
    errors = residuals(fit.x).reshape(len(views), -1, 2)
    view_rms = np.sqrt((errors**2).sum(axis=2).mean(axis=1))
    rms_px = float(np.sqrt((errors**2).sum(axis=2).mean()))
    worst = int(view_rms.argmax())
    if view_rms[worst] > WORST_RMS_PX:
        raise CalibrationError(
            f"the boards do not lie on one floor: {view_rms[worst]:.1f} px off in {views[worst].name}, {rms_px:.1f} px "
            f"in all {len(views)} views, expected at most {WORST_RMS_PX:g} px (a board not flat on the floor, a camera "
            "that moved up or down, wrong intrinsics)"
        )
    sigma = _sigma(fit.jac, errors)
    if not (sigma[0] <= WORST_HEIGHT_SHARE * fit.x[0] and max(sigma[1:]) <= WORST_TILT_RAD):
        raise CalibrationError(
            f"mount known to {100 * sigma[0]:.1f} cm and {math.degrees(max(sigma[1:])):.2f} deg only: bring the board "
            "nearer, to the left, the middle and the right of the picture"
        )
    mount = Mount(float(fit.x[0]) + thickness_m, float(fit.x[1]), float(fit.x[2]))
    return MountFit(mount, rms_px, float(view_rms[worst]), sigma, len(views))


def _project(values: Array, board: Board, lens: Intrinsics) -> Array:
    """All corners, (views, corners, 2) px, of boards at (x_m, y_m, yaw_rad) under a mount (height, pitch, roll)."""
    camera = FloorCamera(lens, Mount(float(values[0]), float(values[1]), float(values[2])))
    # As seen from above, rows follow below when columns go right; the floor's y axis goes left when x goes ahead.
    flat = (board.points_m() - board.points_m().mean(axis=0)) * [1.0, -1.0]
    points = []
    for x_m, y_m, yaw_rad in values[3:].reshape(-1, 3):
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        points.append(flat @ np.array([[c, s], [-s, c]]) + [x_m, y_m])
    return camera.project(np.concatenate(points)).reshape(-1, len(flat), 2)


def _pose_of(view: BoardView, board: Board, lens: Intrinsics) -> tuple[Array, float]:
    """Up, (3,) in the optical frame, and the lens's height over the board, m, from one view."""
    rays = np.ascontiguousarray(lens.rays(view.corners_px)[:, :2])  # so every lens model of ours will do
    flat = np.column_stack([board.points_m() - board.points_m().mean(axis=0), np.zeros(len(rays))])
    good, rotation_vector, place = cv2.solvePnP(flat, rays, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    if not good:
        raise CalibrationError(f"{view.name}: no pose fits the board's corners")
    rotation, _ = cv2.Rodrigues(rotation_vector)
    normal = np.asarray(rotation, dtype=np.float64)[:, 2]
    height_m = -float(normal @ np.ravel(place))
    return (normal, height_m) if height_m > 0 else (-normal, -height_m)


def _place(
    view: BoardView, board: Board, lens: Intrinsics, height_m: float, pitch_rad: float, roll_rad: float
) -> Array:
    """The board's pose on the floor in one view, (x_m, y_m, yaw_rad), by its corners. Raises CalibrationError."""
    try:
        floor = FloorCamera(lens, Mount(height_m, pitch_rad, roll_rad)).floor_points(view.corners_px)
    except GeometryError as error:
        raise CalibrationError(f"{view.name}: the board gives an impossible mount ({error})") from None
    if not np.isfinite(floor).all():
        raise CalibrationError(f"{view.name}: the board is not on the floor, it reaches above the horizon")
    along = floor[board.columns - 1] - floor[0]
    return np.array([*floor.mean(axis=0), math.atan2(along[1], along[0])])


def _sigma(jacobian: Array, errors: Array) -> tuple[float, float, float]:
    freedom = max(errors.size - jacobian.shape[1], 1)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * (errors**2).sum() / freedom
    height_m, pitch_rad, roll_rad = np.sqrt(np.diag(covariance)[:3]).tolist()
    return height_m, pitch_rad, roll_rad
