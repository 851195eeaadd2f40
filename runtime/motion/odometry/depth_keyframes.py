"""Pictures with depth among keyframes: corners matched by descriptor and refined, and the pose they agree on."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import rotation_angle
from edgemap.geometry.camera.depth_points import FARTHEST_M, NEAREST_M
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.odometry.resection import TUKEY, DepthLandmarks, LensPose, Resected, resect
from edgemap.runtime.motion.odometry.corners import FEW

Pixels = NDArray[np.float32]
Indices = NDArray[np.intp]
BORDER_PX = 16  # of a picture, in which a descriptor (31 px) does not fit
WINDOW_PX = 11  # of the refinement


@dataclass(frozen=True, slots=True)
class DepthRule:
    """How a picture with depth is located among keyframes.

    working_width_px: wider pictures are scaled down to it. corners: how many. ratio: of the best to the second best
    descriptor distance (Lowe 2004), below which a match counts. matched: keyframes that a picture is matched to,
    and pictures in a row that are not located, before all are given up. kept: keyframes. apart: from the newest
    keyframe, m and rad, beyond which a picture becomes one; so does one that fewer points fit than a fifth of the
    corners. inliers: that must fit at all. trials: of RANSAC. sigma_px: of a refined corner; RANSAC's matches and the
    refinement lie within the reach of Tukey's weights (`resection.TUKEY`). patch_px: half the side of the patch whose
    depths are one point's; flat: share of the depth by which the middle 80 % of them differ at most, else it lies on an
    edge. depth_sigma_per_m2: standard deviation of a depth, with its square; slope: share of a patch's own spread that
    adds to it, as the middle of the known depths is not the corner's where the patch is cut. fastest_m_s: of a camera
    that is carried. covariance_scale: errors of depth last over steps (NEES over 1 s of two real walks 17 and 12 with
    1).
    """

    working_width_px: int = 540
    corners: int = 500
    ratio: float = 0.8
    matched: int = 3
    kept: int = 8
    apart: float = 0.15
    inliers: int = 12
    trials: int = 200
    sigma_px: float = 0.5
    patch_px: int = 3
    flat: float = 0.06
    depth_sigma_per_m2: float = 0.0035
    slope: float = 0.25
    fastest_m_s: float = 5.0
    covariance_scale: float = 8.0


@dataclass(slots=True, eq=False)
class _Keyframe:
    pose: LensPose
    grey: MatLike
    corners: Pixels
    descriptors: MatLike
    landmarks: DepthLandmarks


class DepthKeyframes:
    """A bounded set of keyframes and the pose of the last picture among them, in the first one's optical axes."""

    def __init__(self, lens: Intrinsics, rule: DepthRule | None = None) -> None:
        self._rule = rule = rule or DepthRule()
        scale = min(1.0, rule.working_width_px / lens.width)
        self._size = round(lens.width * scale), round(lens.height * scale)
        self._lens = lens.scaled(*self._size)
        self._orb = cv2.ORB.create(edgeThreshold=BORDER_PX, nlevels=1)
        self.reset()

    def reset(self) -> None:
        """Discards all keyframes."""
        self._keyframes: list[_Keyframe] = []
        self._last: _Keyframe | None = None  # picture that was located
        self._pose, self._velocity = LensPose.origin(), LensPose.origin()
        self._missed = 0

    def step(self, grey: MatLike, depth: NDArray[np.float32], span_s: float, still: MatLike) -> Resected | None:
        """The motion since the last picture, in its axes; None where it cannot be estimated, and for the first picture.
        still: 0 in the picture where people and animals are, 255 elsewhere. span_s: since the last picture.
        """
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
            still = cv2.resize(still, self._size, interpolation=cv2.INTER_NEAREST)
        corners, descriptors = self._corners(grey, still)
        found = self._located(grey, corners, descriptors) if self._keyframes else None
        moved = None if found is None else self._pose.inverse() @ found.pose
        if moved is not None and np.linalg.norm(moved.position_m) > self._rule.fastest_m_s * span_s:
            found = moved = None
        self._missed = 0 if found is not None else self._missed + 1
        if found is not None and moved is not None:
            self._pose, self._velocity = found.pose, moved
        if self._missed >= self._rule.matched:
            self._keyframes = []
        if found is not None or not self._keyframes:
            self._last = self._seen(grey, corners, descriptors, depth)
            few = found is not None and float(found.weights.sum()) < self._rule.corners / FEW
            if few or not self._keyframes or self._distance(self._keyframes[-1].pose, self._pose, limit=True) > 1.0:
                self._keep(self._last)
        return None if found is None or moved is None else Resected(moved, found.covariance, found.weights)

    @property
    def poses(self) -> tuple[LensPose, ...]:
        """Poses of the keyframes."""
        return tuple(keyframe.pose for keyframe in self._keyframes)

    def moved_on(self, moved: LensPose) -> None:
        """Advances past a picture that was not located, by another source's motion since the last one."""
        self._pose = self._pose @ moved
        self._velocity = moved

    def _corners(self, grey: MatLike, still: MatLike) -> tuple[Pixels, MatLike]:
        rule = self._rule
        mask = None if still.all() else still
        found = cv2.goodFeaturesToTrack(grey, rule.corners, 0.005, WINDOW_PX // 2, mask=mask, blockSize=3)
        if found is None:
            return np.zeros((0, 2), np.float32), np.zeros((0, 32), np.uint8)
        points, descriptors = self._orb.compute(
            grey, [cv2.KeyPoint(x, y, 31.0, 0.0) for x, y in found.reshape(-1, 2).tolist()]
        )
        if descriptors is None:
            return np.zeros((0, 2), np.float32), np.zeros((0, 32), np.uint8)
        return np.asarray(cv2.KeyPoint.convert(points), dtype=np.float32).reshape(-1, 2), descriptors

    def _located(self, grey: MatLike, corners: Pixels, descriptors: MatLike) -> Resected | None:
        """The picture's pose among the keyframes that see most of what it sees."""
        rule, ahead = self._rule, self._pose @ self._velocity
        near = sorted(self._keyframes, key=lambda keyframe: self._distance(keyframe.pose, ahead))[: rule.matched]
        near = near if self._last is None or self._last in near else [*near[: rule.matched - 1], self._last]
        pairs = [(keyframe, *_matches(keyframe.descriptors, descriptors, rule.ratio)) for keyframe in near]
        pairs = [(keyframe, ours, theirs) for keyframe, ours, theirs in pairs if len(ours)]
        if sum(len(ours) for _, ours, _ in pairs) < rule.inliers:
            return None
        landmarks = DepthLandmarks.joined([keyframe.landmarks.chosen(ours) for keyframe, ours, _ in pairs])
        pixels = np.concatenate([corners[theirs] for _, _, theirs in pairs])
        sigma, seen = rule.sigma_px / self._lens.fx, self._lens.rays(pixels)[:, :2]
        found, turned, shift, inliers = cv2.solvePnPRansac(
            landmarks.points_m, seen, np.eye(3), None, iterationsCount=rule.trials, flags=cv2.SOLVEPNP_P3P,
            reprojectionError=TUKEY * sigma, confidence=0.999,
        )  # fmt: skip
        if not found or inliers is None or len(inliers) < rule.inliers:
            return None
        agree = np.zeros(len(seen), dtype=bool)
        agree[inliers.ravel().astype(np.intp)] = True
        pixels = self._refined(grey, pairs, pixels, agree)
        rotation = np.asarray(cv2.Rodrigues(turned)[0], dtype=np.float64).T
        start = LensPose(rotation, -rotation @ np.asarray(shift, dtype=np.float64).ravel())
        located = resect(landmarks.chosen(agree), self._lens.rays(pixels[agree])[:, :2], start, sigma)
        return located if float(located.weights.sum()) >= rule.inliers / 2.0 else None

    def _refined(
        self, grey: MatLike, pairs: list[tuple[_Keyframe, Indices, Indices]], pixels: Pixels, agree: NDArray[np.bool_]
    ) -> Pixels:
        """The matches that agree, moved to where the picture looks like the keyframe (Lucas and Kanade)."""
        refined, first = pixels.copy(), 0
        for keyframe, ours, _ in pairs:
            which = first + np.flatnonzero(agree[first : first + len(ours)])
            before = keyframe.corners[ours[which - first]]
            first += len(ours)
            if not len(which):
                continue
            moved, status, _ = cv2.calcOpticalFlowPyrLK(
                keyframe.grey, grey, before[:, None], pixels[which][:, None].copy(), winSize=[WINDOW_PX] * 2,
                maxLevel=0, criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.02),
                flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            )  # fmt: skip
            moved = moved.reshape(-1, 2)
            near = np.hypot(*(moved - pixels[which]).T) < TUKEY * self._rule.sigma_px
            good = (status.ravel() == 1) & near
            refined[which[good]] = moved[good]
        return refined

    def _seen(self, grey: MatLike, corners: Pixels, descriptors: MatLike, depth: NDArray[np.float32]) -> _Keyframe:
        """The picture with its points, at the pose that was just found."""
        rule = self._rule
        in_depth = (corners + 0.5) * [depth.shape[1] / self._size[0], depth.shape[0] / self._size[1]]
        depth_m, spread_m = patch_depths(depth, in_depth, rule.patch_px, rule.flat)
        known = np.isfinite(depth_m)
        rays, depth_m = self._lens.rays(corners[known]), depth_m[known]
        sigma_m = np.hypot(rule.depth_sigma_per_m2 * depth_m**2, rule.slope * spread_m[known])
        landmarks = DepthLandmarks.observed(self._pose, rays, depth_m, sigma_m)
        return _Keyframe(self._pose, grey, corners[known], descriptors[known], landmarks)

    def _keep(self, picture: _Keyframe) -> None:
        """The picture becomes a keyframe; the one that sees least of what it sees goes."""
        self._keyframes.append(picture)
        if len(self._keyframes) > self._rule.kept:
            self._keyframes.remove(max(self._keyframes, key=lambda one: self._distance(one.pose, picture.pose)))

    def _distance(self, a: LensPose, b: LensPose, limit: bool = False) -> float:
        """Of two views, in units of what makes a keyframe."""
        between = a.inverse() @ b
        shift, turn = float(np.linalg.norm(between.position_m)), rotation_angle(between.rotation)
        return (max(shift, turn) if limit else shift + turn) / self._rule.apart


def patch_depths(
    depth: NDArray[np.float32], pixels: NDArray[np.floating[Any]], half_px: int, flat: float
) -> tuple[Array, Array]:
    """Depths and their scatter (N,) at pixels (N, 2) of a picture (H, W) with holes: medians over the valid pixels of a
    patch; NaN where they are no more than one of its rows, or where the patch covers two depths. Pixels count from the
    picture's outer edge.
    """
    height, width = depth.shape
    columns, rows = np.clip(pixels.astype(np.intp), half_px, [width - 1 - half_px, height - 1 - half_px]).T
    offsets = np.arange(-half_px, half_px + 1)
    patch = depth[rows[:, None, None] + offsets[:, None], columns[:, None, None] + offsets]
    patch = patch.reshape(len(rows), -1)
    patch = np.sort(np.where((patch > NEAREST_M) & (patch < FARTHEST_M), patch, np.inf), axis=1)
    count = np.isfinite(patch).sum(axis=1)
    low, middle, high = (
        patch[np.arange(len(patch)), (share * np.maximum(count - 1, 0)).astype(np.intp)] for share in (0.1, 0.5, 0.9)
    )
    spread = high - np.where(np.isfinite(high), low, 0.0)
    good = (count > 2 * half_px + 1) & (spread < flat * middle)
    return np.where(good, middle, math.nan).astype(np.float64), np.where(good, spread, math.nan).astype(np.float64)


def _matches(own: MatLike, others: MatLike, ratio: float) -> tuple[Indices, Indices]:
    """Indices of descriptors that match: each nearest, and clearly nearer than the second."""
    none = np.zeros(0, dtype=np.intp)
    if len(own) == 0 or len(others) < 2:
        return none, none
    distance, index = cv2.batchDistance(own, others, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=2)[:2]
    clear = np.flatnonzero(distance[:, 0] < ratio * distance[:, 1])
    return clear, index[clear, 0].astype(np.intp)
