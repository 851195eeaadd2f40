"""The chessboard: finding its inner corners in pictures, and keeping pictures with new views."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.runtime.frames.camera import Camera, next_frame
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.frames.frame import Frame

NEW_SHARE = 0.02  # of the picture's width: a board none of whose corners moved more is the same view again
PICTURES = 40  # of a source, from which on more add nothing: views of a board, and pictures for a guess


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard of `columns` x `rows` INNER corners, squares of `square_m`.

    Raises CalibrationError for fewer than 3 inner corners on a side or squares that are not positive.
    """

    columns: int
    rows: int
    square_m: float = 1.0

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise CalibrationError(f"chessboard of {self.columns}x{self.rows} inner corners: need 3 or more each way")
        if not 0.0 < self.square_m < 10.0:
            raise CalibrationError(f"chessboard squares of {self.square_m} m: must be above 0 and below 10 m")

    def points_m(self) -> Array:
        """The corners on the board's own plane, (columns * rows, 2), row by row."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2)
        return grid * self.square_m

    def corners_px(self, image: NDArray[np.uint8]) -> Array | None:
        """The corners in a BGR picture, (columns * rows, 2) px, pixel centres whole; None if any is missing.

        Uses OpenCV's detector of Duda and Frese (2018), and its older one where that fails: for distant boards on the
        floor at a low viewing angle.
        """
        grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        size = (self.columns, self.rows)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        detected, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
        if not detected:
            detected, corners = cv2.findChessboardCorners(grey, size)
            if not detected:
                return None
            corners = self._refined(grey, np.asarray(corners, dtype=np.float32))
        return self._clockwise(np.asarray(corners, dtype=np.float64))

    def _refined(self, grey: NDArray[np.uint8], corners: NDArray[np.float32]) -> Any:
        """Corners to fractions of a pixel, in windows that hold no other corner."""
        grid = corners.reshape(self.rows, self.columns, 2)
        gaps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        half = int(np.clip(min(gaps) / 2.0 - 1.0, 2, 8))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
        return cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), stop)

    def _clockwise(self, corners: Array) -> Array:
        """Corners in the order of an unmirrored board: columns to the right, rows downwards."""
        grid = corners.reshape(self.rows, self.columns, 2)
        along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if along[0] * down[1] - along[1] * down[0] < 0:
            grid = grid[:, ::-1]
        return grid.reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """A board in one picture: its corners, (N, 2) px."""

    name: str
    corners_px: Array


def board_views(
    camera: Camera, board: Board, pictures: int | None = None, stopped: Callable[[], bool] = lambda: False
) -> Iterator[BoardView]:
    """Views that differ from each other, at most 40, as they come. pictures: greatest number of pictures to search.
    Raises CameraError.
    """
    views: list[BoardView] = []
    for frame in frames_of(camera, pictures, stopped):
        corners = board.corners_px(frame.image)
        if corners is not None and all(_is_new(corners, view.corners_px, camera.info.size[0]) for view in views):
            views.append(BoardView(frame.name, corners))
            yield views[-1]
            if len(views) == PICTURES:
                return


def frames_of(camera: Camera, pictures: int | None, stopped: Callable[[], bool] = lambda: False) -> Iterator[Frame]:
    """A camera's frames, up to a number or until stopped."""
    frames = iter(lambda: None if stopped() else next_frame(camera, lambda _: None, stopped), None)
    return islice(frames, pictures)


def _is_new(corners: Array, known: Array, width: int) -> bool:
    forth = np.linalg.norm(corners - known, axis=1).max()
    back = np.linalg.norm(corners[::-1] - known, axis=1).max()  # a board has no right way up
    return bool(min(forth, back) > NEW_SHARE * width)
