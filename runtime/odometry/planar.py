"""Odometry without learning: corners on the floor, followed from frame to frame, moved by one planar motion."""

from __future__ import annotations

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.floor import FloorCamera
from edgemap.geometry.planar import planar_motion
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion, unknown_covariance
from edgemap.runtime.session import Tensors

Array = NDArray[np.float64]

WORKING_WIDTH = 424  # px; wider pictures are scaled down to it
MAX_CORNERS = 200
REACH_HEIGHTS = 12.0  # floor points farther than this many camera heights say little about the way
TRACK_SIGMA_PX = 0.35  # of one tracked corner, at working resolution
GUESSED_STEPS = 5  # frames that the last motion is carried on where tracking fails


class PlanarOdometry:
    """KLT corners (Lucas and Kanade 1981, Shi and Tomasi 1994) below the horizon, RANSAC over SE(2) on the floor.

    A step that finds no motion repeats the last one, with unknown covariance and a fault; after some it stands still.
    """

    name = "planar"

    def __init__(self, camera: FloorCamera, seed: int = 0) -> None:
        scale = min(1.0, WORKING_WIDTH / camera.intrinsics.width)
        size = round(camera.intrinsics.width * scale), round(camera.intrinsics.height * scale)
        self._size = size
        self._camera = FloorCamera(camera.intrinsics.scaled(*size), camera.mount)
        self._mask = _floor_mask(self._camera)
        self._seed = seed
        self.reset("start")

    def step(self, frame: Frame, features: Tensors) -> Motion:  # noqa: ARG002
        """Follow the corners of the last frame into this one."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        last, self._grey = self._grey, grey
        if last is None:
            self._corners = self._find(grey)
            return Motion()
        before, after = self._follow(last, grey)
        found = planar_motion(
            self._camera.floor_points(before),
            self._camera.floor_points(after),
            np.hypot(self._sigmas(before), self._sigmas(after)),
            np.random.default_rng((self._seed, frame.index)),
        )
        if found is None:
            self._corners = self._find(grey)
            return self._guess(len(before))
        self._motion, self._guesses = found.motion, 0
        kept = after[found.inliers].astype(np.float32)
        self._corners = kept if len(kept) > MAX_CORNERS // 2 else self._find(grey, kept)
        return Motion(found.motion, found.covariance)

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the next frame."""
        self._grey: MatLike | None = None
        self._corners = np.zeros((0, 2), dtype=np.float32)
        self._motion, self._guesses = Motion().motion, GUESSED_STEPS

    def _guess(self, corners: int) -> Motion:
        self._guesses += 1
        fault = f"planar odometry: no motion agrees among {corners} floor corners"
        if self._guesses > GUESSED_STEPS:
            return Motion(Motion().motion, unknown_covariance(), fault)
        return Motion(self._motion, unknown_covariance() * 0.05, fault)

    def _find(self, grey: MatLike, known: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        mask = self._mask
        wanted = MAX_CORNERS
        if known is not None and len(known):
            mask = mask.copy()
            for x, y in known:
                cv2.circle(mask, (int(x), int(y)), 5, 0, -1)
            wanted -= len(known)
        corners = cv2.goodFeaturesToTrack(grey, wanted, 0.005, 6, mask=mask, blockSize=3)
        fresh = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2).astype(np.float32)
        return fresh if known is None else np.concatenate([known, fresh])

    def _follow(self, last: MatLike, grey: MatLike) -> tuple[Array, Array]:
        """Pixels (N, 2) before and after, of the corners that were followed to a place on the floor nearby."""
        if len(self._corners) == 0:
            return np.zeros((0, 2)), np.zeros((0, 2))
        points = self._corners.reshape(-1, 1, 2)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            last, grey, points, points.copy(), winSize=(15, 15), maxLevel=3,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.02), minEigThreshold=1e-4,
        )  # fmt: skip
        after = moved.reshape(-1, 2).astype(np.float64)
        inside = ((after >= 0) & (after <= [self._size[0] - 1.0, self._size[1] - 1.0])).all(axis=1)
        good = (status.reshape(-1) == 1) & inside
        good[good] &= self._mask[after[good, 1].round().astype(int), after[good, 0].round().astype(int)] > 0
        return self._corners[good].astype(np.float64), after[good]

    def _sigmas(self, pixels: Array) -> Array:
        """How far a tracking error moves each floor point, (N,) metres."""
        up, down = pixels - [0.0, 0.5], pixels + [0.0, 0.5]
        along = self._camera.floor_points(up) - self._camera.floor_points(down)
        return TRACK_SIGMA_PX * np.nan_to_num(np.linalg.norm(along, axis=1), nan=10.0) + 1e-4


def _floor_mask(camera: FloorCamera) -> NDArray[np.uint8]:
    """255 where a pixel sees the floor within reach, else 0."""
    height, width = camera.intrinsics.height, camera.intrinsics.width
    v, u = np.mgrid[0:height, 0:width]
    points = camera.floor_points(np.column_stack([u.ravel(), v.ravel()]))
    near = np.linalg.norm(points - camera.mount.position_base_m()[:2], axis=1) < REACH_HEIGHTS * camera.mount.height_m
    return (near.reshape(height, width) * 255).astype(np.uint8)
