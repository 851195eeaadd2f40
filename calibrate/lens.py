"""Intrinsics from views of a chessboard, and whether the views determine them."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from edgemap.calibrate.board import Board, BoardView
from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.robust import FEWEST
from edgemap.runtime.frames.errors import CalibrationError

FEWEST_VIEWS = 8
WORST_RMS_PX = 1.0
MINIMUM_COVERAGE = 0.5  # of the picture's width and of its height, by all corners together
WORST_FOCAL_SHARE = 0.01  # one standard deviation
LEANING_DEG = 12.0  # boards all square to the lens fit any focal length, each at its own distance
OUTLIER = 3.0  # times the median view's error


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """The fitted intrinsics. rms_px: over all corners. sigma_px: one standard deviation of fx, fy, cx, cy. view_px,
    lean_deg: error and leaning of each board. dropped: names of views that were left out."""

    intrinsics: Intrinsics
    rms_px: float
    sigma_px: tuple[float, ...]
    view_px: Array
    lean_deg: Array
    dropped: tuple[str, ...] = ()

    def record(self) -> dict[str, Any]:
        """For camera.yaml's `calibration`."""
        return {
            "method": "chessboard",
            "views": len(self.view_px),
            "rms_px": round(self.rms_px, 4),
            "worst_view_px": round(float(self.view_px.max()), 4),
            "sigma_fx_fy_cx_cy_px": [round(value, 3) for value in self.sigma_px],
        }


def fit_lens(views: list[BoardView], board: Board, size: tuple[int, int]) -> LensFit:
    """Focal lengths, principal point and Brown-Conrady's k1, k2, p1, p2 (k3 = 0: boards rarely determine it).

    Zhang's method, by OpenCV. Views that fit three times worse than the median are left out once. size: (width, height)
    of the pictures. Raises CalibrationError, one line with the numbers, where views are too few, see too little of the
    picture, do not fit, or leave the focal length open (boards that never lean).
    """
    _check_views(views, size)
    fit = _calibrated(views, board, size)
    bad = fit.view_px > max(OUTLIER * float(np.median(fit.view_px)), 0.2)
    if bad.any():
        dropped = tuple(view.name for view, is_bad in zip(views, bad, strict=True) if is_bad)
        views = [view for view, is_bad in zip(views, bad, strict=True) if not is_bad]
        _check_views(views, size)
        fit = replace(_calibrated(views, board, size), dropped=dropped)
    if fit.rms_px > WORST_RMS_PX:
        raise CalibrationError(
            f"the boards fit a lens to {fit.rms_px:.2f} px, expected at most {WORST_RMS_PX} px: blur, a board that "
            "is not flat, or a lens that is not Brown-Conrady's"
        )
    leaning = int((fit.lean_deg >= LEANING_DEG).sum())
    if leaning < FEWEST:
        raise CalibrationError(
            f"{leaning} of {len(views)} boards lean by {LEANING_DEG:g} degrees or more, need {FEWEST}: without "
            "them the focal length is open; lean the board by 30 degrees to all sides"
        )
    share = max(fit.sigma_px[0] / fit.intrinsics.fx, fit.sigma_px[1] / fit.intrinsics.fy)
    if not share <= WORST_FOCAL_SHARE:
        raise CalibrationError(
            f"focal length known to {100 * share:.1f} % only, expected {100 * WORST_FOCAL_SHARE:g} %: more views that "
            "fill the picture"
        )
    return fit


def _calibrated(views: list[BoardView], board: Board, size: tuple[int, int]) -> LensFit:
    flat = np.column_stack([board.points_m(), np.zeros(board.columns * board.rows)]).astype(np.float32)
    corners = [view.corners_px.astype(np.float32).reshape(-1, 1, 2) for view in views]
    extended: Any = cv2.calibrateCameraExtended
    try:
        rms, k, distortion, rotation_vectors, _, sigma, _, errors = extended(
            [flat.reshape(-1, 1, 3)] * len(views), corners, size, None, None, flags=cv2.CALIB_FIX_K3
        )
    except cv2.error as error:
        raise CalibrationError(f"no lens fits the {len(views)} boards ({error.err})") from None
    facing = [abs(float(np.asarray(cv2.Rodrigues(rotation_vector)[0])[2, 2])) for rotation_vector in rotation_vectors]
    lean_deg = np.degrees(np.arccos(np.clip(facing, 0.0, 1.0)))
    bend = Distortion("brown_conrady", (*distortion.ravel()[:4].tolist(), 0.0))
    lens = Intrinsics(*size, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), bend)
    return LensFit(lens, float(rms), tuple(sigma.ravel()[:4].tolist()), errors.ravel(), lean_deg)


def _check_views(views: list[BoardView], size: tuple[int, int]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise CalibrationError(
            f"{len(views)} different views of the complete board found, need {FEWEST_VIEWS} or more (is --board its "
            "number of INNER corners?)"
        )
    corners = np.concatenate([view.corners_px for view in views])
    shares = np.ptp(corners, axis=0) / size
    if shares.min() < MINIMUM_COVERAGE:
        raise CalibrationError(
            f"the boards cover {100 * shares[0]:.0f} % of the picture's width and {100 * shares[1]:.0f} % of its "
            f"height, need {100 * MINIMUM_COVERAGE:.0f} %: bring the board to all corners of the picture"
        )
