"""Corners that are tracked from picture to picture (Lucas and Kanade 1981, Shi and Tomasi 1994)."""

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
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.odometry.keyframe_window import ImagePoints, rows_of
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
    tracked back are dropped. unit_m: of the inverse depths of `ImagePoints`.
    """

    def __init__(self, camera: FloorCamera, rule: CornersRule, unit_m: float = 1.0) -> None:
        scale = min(1.0, rule.working_width_px / camera.intrinsics.width)
        self._size = round(camera.intrinsics.width * scale), round(camera.intrinsics.height * scale)
        self.intrinsics = camera.intrinsics.scaled(*self._size)
        self._rule, self._unit_m = rule, unit_m
        self._rays = _ray_table(self.intrinsics)
        self._coarse = self._rays[MASK_PX // 2 :: MASK_PX, MASK_PX // 2 :: MASK_PX]
        # Size at which shifts are estimated, OpenCV's least is 2 px; its window suppresses effects of the edges.
        self._low_size = max(self._size[0] // SHIFT_PX, 2), max(self._size[1] // SHIFT_PX, 2)
        self._window = cv2.createHanningWindow(self._low_size, cv2.CV_32F)
        self._last = self._picture = Picture(np.zeros(self._size[::-1], dtype=np.uint8))
        # The corners, and their motion since the picture before, NaN of new ones.
        self.corners = self._moved_px = np.zeros((0, 2), dtype=np.float32)
        self.ids, self._next_id = np.zeros(0, dtype=np.int64), 0
        self._kept: dict[int, tuple[Picture, Pixels, NDArray[np.int64]]] = {}  # pictures with their corners and ids
        self._floor = np.zeros(self._size[::-1], dtype=np.float32)

    def take(self, frame: Frame, movers: Array, span_s: float, camera: FloorCamera, seen: FloorMask | None) -> None:
        """A new picture. movers: (N, 4) boxes of people and animals, px of the frame. span_s: since the last one.
        Corners may lie on the floor within this camera's reach and, with a mask, on its floor."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        self._last.depth = None  # older pictures are kept without it
        self._last, self._picture, self._span_s = self._picture, Picture(grey, frame.depth), span_s
        self._movers = (movers * (self._size[0] / frame.image.shape[1])).astype(np.intp)
        self._still = np.full(self._size[::-1], 255, dtype=np.uint8)
        margin = self._rule.apart_px
        for x0, y0, x1, y1 in self._movers.tolist():
            self._still[max(y0 - margin, 0) : y1 + margin, max(x0 - margin, 0) : x1 + margin] = 0
        reached, self._floor_before = self._within_reach(camera), self._floor
        self._floor = np.asarray(reached, dtype=np.float32)
        if seen is not None:
            self._floor = cv2.resize(seen.floor, self._size, interpolation=cv2.INTER_LINEAR)
        self._mask = np.where(reached & (self._floor >= 0.5), 255, 0).astype(np.uint8)

    def follow(self, expected: Pixels, shifted: bool, detail: bool) -> None:
        """Tracks the corners into the new picture, from where they are expected (N, 2); those that fail or leave the
        picture are dropped. shifted: the picture may have moved farther than expected. detail: corners are refined
        where large structures count half."""
        if len(self.corners) == 0:
            return
        if shifted:
            expected = expected + self._surprise(self._last, self._picture, expected)
        moved, good = self._moved(self._last, self._picture, self.corners, expected, detail)
        good &= self._inside(moved)
        self._moved_px = (moved - self.corners)[good]
        self.corners, self.ids = moved[good], self.ids[good]

    def keep(self, numbers: Sequence[int]) -> None:
        """Keeps the newest picture, which is the last of these, and of the others those that are kept."""
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
        count, wanted = len(self.ids), self._inside(expected) & np.isfinite(before).all(axis=1)
        for number in np.unique(numbers[wanted]).tolist():
            picture, corners, known = self._kept[number]
            rows = rows_of(ids, known)
            mine = np.flatnonzero(wanted & (numbers == number) & (rows >= 0))
            if not len(mine):
                continue
            moved, good = self._moved(picture, self._picture, corners[rows[mine]], expected[mine], detail)
            off = moved - expected[mine]
            good &= self._inside(moved) & (np.hypot(*off.T) < near_px)
            self._add(moved[good], (before[mine] + off)[good], ids[mine][good])
        return self.ids[count:]

    def find_again(self, far_px: float) -> tuple[ImagePoints, Array, Array] | None:
        """Adds corners by the descriptors of both pictures (ORB, Rublee et al. 2011), where they agree with one rigid
        motion (Nister 2004) and half of them have moved by far_px: of a short step this is not the motion. Returns them
        in the picture before, and rotation (3, 3) and direction (3,) of the motion, which take points of the lens
        before into the lens of now."""
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
        floor = _values_at(before, self._floor_before)
        others = round((1.0 - self._rule.floor_share) * self._rule.corners)  # else none are sought on the floor
        inside &= (floor >= 0.5) | (np.cumsum(inside & (floor < 0.5)) <= others)
        before = before[inside]
        ids = self._add(now[inside], before)
        points, inverse_m = self.bearings(before), self._inverse_depths(before, self._last)
        found = ImagePoints(ids, points, np.zeros_like(points), floor[inside], inverse_m)
        return found, np.asarray(turn, np.float64), np.asarray(way, np.float64).ravel()

    def seek(self, more: float, scattered: bool) -> None:
        """Replaces missing corners, first on the floor: a wall's contrast must not hide it. Elsewhere as many as are
        still missing. more: share of `CornersRule.corners` that is sought in addition. scattered: they are spread over
        the picture, as one piece of furniture must not hide the room; else the strongest are taken, which large motions
        need."""
        count = round((1.0 + more) * self._rule.corners)
        if count - len(self.corners) < count // FEW:
            return
        grey = self._picture.grey
        free = np.full(grey.shape, 255, dtype=np.uint8)
        for corner in self.corners.astype(np.intp).tolist():
            cv2.circle(free, corner, self._rule.apart_px, 0, -1)
        elsewhere = len(self.corners) - int((_values_at(self.corners, self._mask) > 0).sum())
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
            self._add(fresh, np.full_like(fresh, np.nan))

    def _add(self, corners: Pixels, before: Array | Pixels, ids: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """Adds corners (N, 2), which were there in the picture before; returns their ids, new ones by default."""
        if ids is None:
            ids = self._next_id + np.arange(len(corners))
            self._next_id += len(corners)
        self.corners, self.ids = np.concatenate([self.corners, corners]), np.concatenate([self.ids, ids])
        self._moved_px = np.concatenate([self._moved_px, corners - before.astype(np.float32)])
        return ids

    def tracks(self) -> ImagePoints:
        """The corners that do not lie on people or animals."""
        still = _values_at(self.corners, self._still) > 0
        corners = self.corners[still]
        late, floor = self._late(corners, self._moved_px[still]), _values_at(corners, self._floor)
        inverse_m = self._inverse_depths(corners, self._picture)
        return ImagePoints(self.ids[still], self.bearings(corners), late, floor, inverse_m)

    def tracks_before(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Ids, points and `late`, as of `ImagePoints`, of all corners that were tracked, in the picture before."""
        tracked = np.isfinite(self._moved_px[:, 0])
        moved_px = self._moved_px[tracked]
        before = self.corners[tracked] - moved_px
        return self.ids[tracked], self.bearings(before), self._late(before, moved_px)

    def _late(self, pixels: Pixels, moved_px: Pixels) -> Array:
        """As of `ImagePoints`, of corners at pixels (N, 2) that moved by (N, 2) px, NaN of new ones: the shutter's
        middle row counts as the picture's moment."""
        late = (pixels[:, 1:] + 0.5) / self._size[1] - 0.5
        return late * (np.nan_to_num(moved_px) / [self.intrinsics.fx, self.intrinsics.fy] / self._span_s)

    def _inverse_depths(self, pixels: Pixels, picture: Picture) -> Array:
        """Inverse depth (N,) at pixels (N, 2) of a picture, NaN where it was not measured."""
        if picture.depth is None:
            return np.full(len(pixels), np.nan)
        scale = np.divide(picture.depth.shape[::-1], self._size)
        return self._unit_m / patch_depths(picture.depth, (pixels + 0.5) * scale)

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

    def _within_reach(self, camera: FloorCamera) -> Mask:
        """Where the floor is within reach (H, W); computed on every `MASK_PX`-th pixel."""
        down = camera.mount.rotation_base_optical()[2]
        falls = -(self._coarse @ down[:2] + down[2]) / np.sqrt((self._coarse**2).sum(axis=2) + 1.0)
        reaches = (falls * self._rule.reach_heights > 1.0).astype(np.uint8)
        return cv2.resize(reaches, self._size, interpolation=cv2.INTER_NEAREST) > 0

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
        size, pictures = self._low_size, (last.grey, now.grey)
        small = [cv2.resize(p, size, interpolation=cv2.INTER_AREA).astype(np.float32) for p in pictures]
        if len(self._movers):
            still = cv2.resize(self._still, size, interpolation=cv2.INTER_NEAREST)
            small = [np.where(still, p - cv2.mean(p, still)[0], 0.0).astype(np.float32) for p in small]
        shift, response = cv2.phaseCorrelate(small[0], small[1], self._window)
        surprise = SHIFT_PX * np.array(shift) - np.median(expected - self.corners, axis=0)
        clear = response > self._rule.shift_response and np.hypot(*surprise) > self._rule.window_px / 2 * 2**LEVELS
        return surprise.astype(np.float32) if clear else np.zeros(2, dtype=np.float32)


def _values_at(pixels: Pixels, image: MatLike) -> Array:
    """The values (N,) of an image at pixels (N, 2)."""
    columns, rows = pixels.astype(np.intp).T
    return image[rows, columns].astype(np.float64)


def spread(detected: Pixels, kept: Pixels, count: int) -> Pixels:
    """Of detected corners (N, 2), the strongest first, those farthest from any stronger one and from any kept one
    (M, 2): adaptive non-maximal suppression (Brown, Szeliski and Winder 2005)."""
    if len(detected) <= count:
        return detected
    stronger = np.tri(len(detected), k=-1, dtype=np.bool_)
    nearest = cdist(detected, detected, "sqeuclidean").min(axis=1, initial=np.inf, where=stronger)
    nearest = np.minimum(nearest, cdist(detected, kept, "sqeuclidean").min(axis=1, initial=np.inf))
    return detected[np.sort(np.argsort(-nearest, kind="stable")[:count])]


def _ray_table(lens: Intrinsics) -> Array:
    """Normalised image points of all pixels, (height, width, 2)."""
    v, u = np.mgrid[0 : lens.height, 0 : lens.width]
    return lens.rays(np.column_stack([u.ravel(), v.ravel()]))[:, :2].reshape(lens.height, lens.width, 2)
