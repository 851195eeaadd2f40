"""Corners that are tracked from picture to picture (Lucas and Kanade 1981, Shi and Tomasi 1994)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import patch_depths
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.odometry.keyframe_window import rows_of
from edgemap.runtime.frames.frame import Frame

Pixels = NDArray[np.float32]
Mask = NDArray[np.bool_]

LEVELS = 3  # levels of the tracker's pyramid; with two, tracking fails when a robot starts to spin suddenly
LARGE_PX = 31  # a structure that is larger counts half when a corner is refined
BACK_PX = 0.7  # largest difference of a corner that is tracked forward and back again
SHIFT_PX = 4  # the picture's shift is estimated on every n-th pixel
RESPONSE_PX = 3  # radius around a corner in which its response reads the picture
MASK_PX = 8  # the reach of the floor is computed on every n-th pixel
# Features that are described in a picture, pixels within which a pair agrees with a rigid motion, and fewest pairs that
# do (over a real gap 130 and more, of noise up to 28 by chance); ORB's own border hides a sixth of a small picture.
FEATURES, PAIR_PX, FEWEST_PAIRS, ORB_BORDER_PX = 800, 1.5, 40, 15
FEW = 5  # a fifth of the corners: fewer missing ones are not replaced
CANDIDATES = 4  # corners that are detected for each one that is missing


@dataclass(frozen=True, slots=True)
class CornersRule:
    """How corners are tracked."""

    working_width_px: int = 320  # wider pictures are scaled down to this width
    window_px: int = 11  # size of the tracker's window; the spacing of corners is at least half of it
    corners: int = 160  # number of corners; of a carried camera without depth twice as many
    floor_share: float = 0.6  # share of the corners that are sought where the floor is within reach
    # Minimum response of the phase correlation; the picture's shift is then used for motions beyond the tracker's
    # reach.
    shift_response: float = 0.15
    reach_heights: float = 12.0  # range, in camera heights, beyond which no corner counts as floor

    @property
    def apart_px(self) -> int:
        """Minimum distance between two corners, px."""
        return (self.window_px + 1) // 2


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Corners tracked from the picture before: ids (N,); there, normalised image points (N, 2), probability of floor
    and depth (N,), NaN where it was not measured. turn (3, 3), way (3,): rotation and direction of the motion, which
    take points of the lens before into the lens of now."""

    ids: NDArray[np.int64]
    points: Array
    floor: Array
    depth_m: Array
    turn: Array
    way: Array


class Picture:
    """A grey picture at the working width, and its cached filtered versions. depth: (H, W) metres of the frame."""

    def __init__(self, grey: MatLike, depth: NDArray[np.float32] | None = None) -> None:
        self.grey, self.depth = grey, depth

    @cached_property
    def half(self) -> MatLike:
        """Half as wide."""
        return cv2.pyrDown(self.grey)

    @cached_property
    def detail(self) -> MatLike:
        """Large structures have half their contrast: they pull corners of weakly textured floors along, which makes a
        robot appear slower (home 9001: by 16 % before a wall)."""
        return cv2.addWeighted(self.grey, 1.0, cv2.blur(self.grey, (LARGE_PX, LARGE_PX)), -0.5, 64.0)


class CornerTracker:
    """Up to `CornersRule.corners` corners, and where they may lie on the floor.

    corners (N, 2), px at the working width; ids (N,). Corners that do not return to where they were when they are
    tracked back are dropped.
    """

    def __init__(self, camera: FloorCamera, rule: CornersRule) -> None:
        scale = min(1.0, rule.working_width_px / camera.intrinsics.width)
        self._size = round(camera.intrinsics.width * scale), round(camera.intrinsics.height * scale)
        self.intrinsics = camera.intrinsics.scaled(*self._size)
        self._rule = rule
        self._rays = _ray_table(FloorCamera(self.intrinsics, camera.mount))
        self._coarse = self._rays[MASK_PX // 2 :: MASK_PX, MASK_PX // 2 :: MASK_PX]
        self._window: MatLike | None = None  # suppresses edge effects of the phase correlation
        self._next_id = 0
        self._reached_by: FloorCamera | None = None
        self.restart()

    def restart(self) -> None:
        """Discards the picture and its corners."""
        self._last: Picture | None = None
        self._picture: Picture | None = None
        self.corners = np.zeros((0, 2), dtype=np.float32)
        self.ids = np.zeros(0, dtype=np.int64)
        self._kept: dict[int, tuple[Picture, Pixels, NDArray[np.int64]]] = {}  # pictures with their corners and ids
        self._before, self._span_s = (self.corners, self.ids), math.inf
        self._floor, self._mask = None, np.zeros(self._size[::-1], dtype=np.uint8)

    @property
    def started(self) -> bool:
        """Whether there is a picture."""
        return self._picture is not None

    @property
    def follows(self) -> bool:
        """Whether there is a picture before the last one."""
        return self._last is not None

    def take(self, frame: Frame, movers: Array, span_s: float) -> None:
        """A new picture. movers: (N, 4) boxes of people and animals, px of the frame. span_s: since the last one."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        if self._last is not None:
            self._last.depth = None  # older pictures are kept without it
        self._last, self._picture, self._span_s = self._picture, Picture(grey, frame.depth), span_s
        self._movers = (movers * (self._size[0] / frame.image.shape[1])).astype(np.intp)
        self._still = np.full(self._size[::-1], 255, dtype=np.uint8)
        margin = self._rule.apart_px
        for x0, y0, x1, y1 in self._movers.tolist():
            self._still[max(y0 - margin, 0) : y1 + margin, max(x0 - margin, 0) : x1 + margin] = 0

    def mark_floor(self, camera: FloorCamera, seen: FloorMask | None) -> None:
        """Marks where corners may lie on the floor: within this camera's reach and, with a mask, on its floor."""
        if camera is not self._reached_by:
            self._reached_by, self._reached = camera, self._within_reach(camera)
        self._floor_before = self._floor, self._mask
        self._floor, self._mask = None, self._reached
        if seen is not None:
            self._floor = cv2.resize(seen.floor, self._size, interpolation=cv2.INTER_LINEAR)
            self._mask = np.where(self._floor >= 0.5, self._reached, 0).astype(np.uint8)

    def follow(self, expected: Pixels, shifted: bool, detail: bool) -> None:
        """Tracks the corners into the new picture, from where they are expected (N, 2); those that fail or leave the
        picture are dropped. shifted: the picture may have moved farther than expected. detail: corners are refined
        where large structures count half."""
        self._before = self.corners, self.ids
        if self._last is None or self._picture is None or len(self.corners) == 0:
            return
        if shifted:
            expected = expected + self._surprise(self._last, self._picture, expected)
        moved, good = self._moved(self._last, self._picture, self.corners, expected, detail)
        good &= self._inside(moved)
        self.corners, self.ids = moved[good], self.ids[good]

    def keep(self, numbers: Sequence[int]) -> None:
        """Keeps the newest picture, which is the last of these, and of the others those that are kept."""
        if self._picture is not None:
            newest = self._picture, self.corners, self.ids
            self._kept = {one: self._kept[one] for one in numbers[:-1]} | {numbers[-1]: newest}

    def find_lost(
        self,
        ids: NDArray[np.int64],
        numbers: NDArray[np.int64],
        expected: Pixels,
        before: Pixels,
        near_px: float,
        detail: bool,
    ) -> NDArray[np.int64]:
        """Tracks lost corners (N,) from the kept pictures (N,) that last showed them, and adds those that are within
        near_px of where they are expected; returns their ids. expected, before (N, 2): px in this picture and in the
        one before, NaN where a corner would be behind the lens."""
        added = [(self.corners, self.ids, self._before[0], self._before[1])]
        wanted = self._inside(expected) & np.isfinite(before).all(axis=1)
        for number in np.unique(numbers[wanted]).tolist():
            picture, corners, known = self._kept[number]
            rows = rows_of(ids, known)
            mine = np.flatnonzero(wanted & (numbers == number) & (rows >= 0))
            if self._picture is None or not len(mine):
                continue
            moved, good = self._moved(picture, self._picture, corners[rows[mine]], expected[mine], detail)
            off = moved - expected[mine]
            good &= self._inside(moved) & (np.hypot(*off.T) < near_px)
            added.append((moved[good], ids[mine][good], (before[mine] + off)[good].astype(np.float32), ids[mine][good]))
        self.corners, self.ids, corners, ids = (np.concatenate(part) for part in zip(*added, strict=True))
        self._before = corners, ids
        return self.ids[len(added[0][1]) :]

    def find_again(self, far_px: float) -> Found | None:
        """Adds corners by the descriptors of both pictures (ORB, Rublee et al. 2011), where they agree with one rigid
        motion (Nister 2004) and half of them have moved by far_px: of a short step this is not the motion."""
        if self._last is None or self._picture is None:
            return None
        orb = cv2.ORB.create(FEATURES, edgeThreshold=ORB_BORDER_PX)
        first, of_first = orb.detectAndCompute(self._last.grey, None)
        second, of_second = orb.detectAndCompute(self._picture.grey, self._still)
        if of_first is None or of_second is None:
            return None
        pairs = cv2.BFMatcher.create(cv2.NORM_HAMMING, crossCheck=True).match(of_first, of_second)
        pairs = sorted(pairs, key=lambda pair: pair.distance)
        if len(pairs) < FEWEST_PAIRS:
            return None
        before = np.array([first[pair.queryIdx].pt for pair in pairs], dtype=np.float32)
        now = np.array([second[pair.trainIdx].pt for pair in pairs], dtype=np.float32)
        seen = self.bearings(before), self.bearings(now)
        essential, inside = cv2.findEssentialMat(*seen, np.eye(3), cv2.RANSAC, 0.999, PAIR_PX / self.intrinsics.fx)
        if essential is None or inside.sum() < FEWEST_PAIRS:
            return None
        _, turn, way, _ = cv2.recoverPose(essential[:3], *seen, np.eye(3), mask=inside.copy())
        inside = inside.ravel() > 0
        if np.median(np.hypot(*(now - before)[inside].T)) < far_px:
            return None
        floor = self._sampled(before, *self._floor_before)
        others = round((1.0 - self._rule.floor_share) * self._rule.corners)  # else none are sought on the floor
        inside &= (floor >= 0.5) | (np.cumsum(inside & (floor < 0.5)) <= others)
        before, now = before[inside], now[inside]
        ids = self._next_id + np.arange(len(before))
        self._next_id += len(before)
        self.corners, self.ids = np.concatenate([self.corners, now]), np.concatenate([self.ids, ids])
        self._before = np.concatenate([self._before[0], before]), np.concatenate([self._before[1], ids])
        return Found(
            ids,
            self.bearings(before),
            floor[inside],
            self._depths_m(before, self._last.depth),
            np.asarray(turn, np.float64),
            np.asarray(way, np.float64).ravel(),
        )

    def seek(self, more: float, scattered: bool) -> None:
        """Replaces missing corners, first on the floor: a wall's contrast must not hide it. Elsewhere as many as are
        still missing. more: share of `CornersRule.corners` that is sought in addition. scattered: they are spread over
        the picture, as one piece of furniture must not hide the room; else the strongest are taken, which large motions
        need."""
        count = round((1.0 + more) * self._rule.corners)
        if self._picture is None or count - len(self.corners) < count // FEW:
            return
        grey = self._picture.grey
        free = np.full(grey.shape, 255, dtype=np.uint8)
        for corner in self.corners.astype(np.intp).tolist():
            cv2.circle(free, corner, self._rule.apart_px, 0, -1)
        elsewhere = len(self.corners) - int(self._on_floor(self.corners).sum())
        for mask, most in (
            (free & self._mask, round(self._rule.floor_share * count) + elsewhere),
            (free & ~self._mask, count),
        ):
            wanted = most - len(self.corners)
            lines = np.flatnonzero(mask.any(axis=1))
            if wanted <= 0 or not len(lines):
                continue
            top, bottom = max(lines[0] - RESPONSE_PX, 0), lines[-1] + 1 + RESPONSE_PX
            detected = cv2.goodFeaturesToTrack(
                grey[top:bottom],
                CANDIDATES * wanted if scattered else wanted,
                0.005,
                self._rule.apart_px,
                mask=mask[top:bottom],
                blockSize=3,
            )
            if detected is None:
                continue
            fresh = np.asarray(detected.reshape(-1, 2) + [0.0, top], dtype=np.float32)
            fresh = spread(fresh, self.corners, wanted)
            self.ids = np.concatenate([self.ids, self._next_id + np.arange(len(fresh))])
            self._next_id += len(fresh)
            self.corners = np.concatenate([self.corners, fresh])

    def _on_floor(self, pixels: Pixels) -> Mask:
        """Whether each pixel (N, 2) may lie on the floor, (N,)."""
        columns, rows = pixels.astype(np.intp).T
        return self._mask[rows, columns] > 0

    def _doubtful(self, pixels: Pixels) -> Mask:
        """Whether each pixel (N, 2) lies on a person or an animal, (N,)."""
        columns, rows = pixels.astype(np.intp).T
        return self._still[rows, columns] == 0

    def tracks(self) -> tuple[NDArray[np.int64], Array, Array, Array, Array]:
        """Ids, normalised image points, probability of floor, depth in metres, NaN where it was not measured, and
        `late` as of `observed`."""
        corners = self.corners[~self._doubtful(self.corners)]
        depth = None if self._picture is None else self._picture.depth
        floor = self._sampled(corners, self._floor, self._mask)
        ids, points, late = self.observed()
        return ids, points, floor, self._depths_m(corners, depth), late

    def observed(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Ids and normalised image points of the corners that do not lie on people or animals, and how far they would
        move for each second of the shutter's readout (N, 2), 0 of new ones."""
        still = ~self._doubtful(self.corners)
        late = self._late(self.corners, self._moved_px())
        return self.ids[still], self.bearings(self.corners[still]), late[still]

    def observed_before(self) -> tuple[NDArray[np.int64], Array, Array]:
        """As `observed`, of all corners that were tracked, in the picture before."""
        moved = self._moved_px()
        tracked = np.isfinite(moved[:, 0])
        before = np.asarray(self.corners[tracked] - moved[tracked], dtype=np.float32)
        return self.ids[tracked], self.bearings(before), self._late(before, moved[tracked])

    def _moved_px(self) -> Array:
        """The corners' motion since the picture before, (N, 2) px; NaN of new ones."""
        corners, ids = self._before
        rows, moved = rows_of(self.ids, ids), np.full((len(self.ids), 2), np.nan)
        known = rows >= 0
        moved[known] = self.corners[known] - corners[rows[known]]
        return moved

    def _late(self, pixels: Array | Pixels, moved_px: Array) -> Array:
        """How far normalised image points at pixels (N, 2) would move for each second of the shutter's readout, as its
        middle row counts as the picture's moment."""
        late = (pixels[:, 1:] + 0.5) / self._size[1] - 0.5
        speed = np.nan_to_num(moved_px) / [self.intrinsics.fx, self.intrinsics.fy] / self._span_s
        return late * speed

    def _depths_m(self, pixels: Pixels, depth: NDArray[np.float32] | None) -> Array:
        """Depth (N,) at pixels (N, 2), NaN where it was not measured."""
        if depth is None:
            return np.full(len(pixels), np.nan)
        return patch_depths(depth, (pixels + 0.5) * np.divide(depth.shape[::-1], self._size))

    @staticmethod
    def _sampled(pixels: Pixels, floor: MatLike | None, mask: MatLike) -> Array:
        """Probability of floor at pixels (N, 2), by a floor mask or by the reach alone."""
        columns, rows = pixels.astype(np.intp).T
        return (mask > 0 if floor is None else floor)[rows, columns].astype(np.float64)

    def bearings(self, pixels: Pixels) -> Array:
        """Normalised image points (N, 2) without lens distortion, interpolated in a table of all pixels."""
        corner = np.clip(pixels.astype(np.intp), 0, [self._size[0] - 2, self._size[1] - 2])
        part = pixels - corner
        u, v = corner.T
        a, b = part[:, :1], part[:, 1:]
        table = self._rays
        return (1 - b) * ((1 - a) * table[v, u] + a * table[v, u + 1]) + b * (
            (1 - a) * table[v + 1, u] + a * table[v + 1, u + 1]
        )

    def _within_reach(self, camera: FloorCamera) -> NDArray[np.uint8]:
        """Mask: 255 where the floor is within reach, 0 elsewhere; computed on every `MASK_PX`-th pixel."""
        down = camera.mount.rotation_base_optical()[2]
        falls = -(self._coarse @ down[:2] + down[2]) / np.sqrt((self._coarse**2).sum(axis=2) + 1.0)
        reaches = (falls * self._rule.reach_heights > 1.0).astype(np.uint8) * 255
        return np.asarray(cv2.resize(reaches, self._size, interpolation=cv2.INTER_NEAREST))

    def _inside(self, pixels: Array | Pixels) -> Mask:
        """Whether each pixel (N, 2) lies in the picture, (N,)."""
        return np.all((pixels >= 0) & (pixels <= [self._size[0] - 1.0, self._size[1] - 1.0]), axis=1)

    def _moved(
        self, last: Picture, now: Picture, corners: Pixels, expected: Pixels, detail: bool
    ) -> tuple[Pixels, Mask]:
        """Corners (N, 2) of one picture in another, and which were tracked."""
        if detail:
            coarse, near = self._tracked(last.half, now.half, corners / 2.0, expected / 2.0, LEVELS - 1)
            moved, good = self._tracked(last.detail, now.detail, corners, 2.0 * coarse, 0)
            good &= near
        else:  # KITTI from frame 500: 5.6 %, with detail 7.9
            moved, good = self._tracked(last.grey, now.grey, corners, expected, LEVELS)
        back, returned = self._tracked(now.grey, last.grey, moved, corners, 1)
        return moved, good & returned & (np.abs(back - corners).max(axis=1) < BACK_PX)

    def _tracked(
        self, last: MatLike, grey: MatLike, corners: Pixels, expected: Pixels, levels: int
    ) -> tuple[Pixels, Mask]:
        """Corners (N, 2) of one picture tracked into another from where they are expected, and whether they were."""
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            last, grey, corners[:, None], expected[:, None].copy(), winSize=[self._rule.window_px] * 2,
            maxLevel=levels, criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-4,
        )  # fmt: skip
        return np.asarray(moved.reshape(-1, 2), dtype=np.float32), status.reshape(-1) == 1

    def _surprise(self, last: Picture, now: Picture, expected: Pixels) -> Pixels:
        """Unexpected shift of the picture, (2,) px; zero unless it is more than the tracker can follow."""
        width, height = (max(side // SHIFT_PX, 2) for side in self._size)  # OpenCV's window needs two
        if self._window is None:
            self._window = cv2.createHanningWindow((width, height), cv2.CV_32F)
        pictures = last.grey, now.grey
        small = [cv2.resize(p, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) for p in pictures]
        if len(self._movers):
            still = cv2.resize(self._still, (width, height), interpolation=cv2.INTER_NEAREST)
            small = [np.where(still, p - cv2.mean(p, still)[0], 0.0).astype(np.float32) for p in small]
        shift, response = cv2.phaseCorrelate(small[0], small[1], self._window)
        surprise = SHIFT_PX * np.array(shift) - np.median(expected - self.corners, axis=0)
        clear = response > self._rule.shift_response and np.hypot(*surprise) > self._rule.window_px / 2 * 2**LEVELS
        return surprise.astype(np.float32) if clear else np.zeros(2, dtype=np.float32)


def spread(detected: Pixels, kept: Pixels, count: int) -> Pixels:
    """Of detected corners (N, 2), the strongest first, those farthest from any stronger one and from any kept one
    (M, 2): adaptive non-maximal suppression (Brown, Szeliski and Winder 2005)."""
    if len(detected) <= count:
        return detected
    stronger = np.tri(len(detected), k=-1, dtype=np.bool_)
    nearest = cdist(detected, detected, "sqeuclidean").min(axis=1, initial=np.inf, where=stronger)
    nearest = np.minimum(nearest, cdist(detected, kept, "sqeuclidean").min(axis=1, initial=np.inf))
    return detected[np.sort(np.argsort(-nearest, kind="stable")[:count])]


def _ray_table(camera: FloorCamera) -> Array:
    """Normalised image points of all pixels, (height, width, 2)."""
    height, width = camera.intrinsics.height, camera.intrinsics.width
    v, u = np.mgrid[0:height, 0:width]
    return camera.intrinsics.rays(np.column_stack([u.ravel(), v.ravel()]))[:, :2].reshape(height, width, 2)
