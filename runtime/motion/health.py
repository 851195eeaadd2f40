"""Whether a picture is usable, checked before detector, odometry and map use it."""

import math
from collections import deque
from dataclasses import dataclass, replace

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import SELDOM_S
from edgemap.runtime.frames.timing import StreamTimer

WORKING_WIDTH = 160  # px; pictures are averaged down to about this width, which takes the noise out
FINE_PX, COARSE_PX = 5, 15  # boxes at the working width; structure between them, and below the first
PERCENTILE = 0.99  # of the absolute structure
REPEATED_S = SELDOM_S  # of stream, between two faults that report one lasting condition
MIDDLE_GREY = 128  # decoders leave it where data is missing
TILES = 16, 12  # across and down, of a picture that may be covered in part; a torn one lacks a row of them
BLACK = 16  # grey level of black in video (ITU-R BT.601)
VIEW_PX = 40, 30  # size at which views are compared


@dataclass(frozen=True, slots=True)
class HealthRule:
    """When a picture counts as unusable."""

    # Grey levels of coarse structure; a covered lens, a dark room or a plain wall close by has less (photographs: 23).
    # A pixel so near to the greatest level counts as saturated.
    covered: int = 5
    # Fine over coarse structure; Gaussian blur of 6 px at 640 has 0.36, moving cameras 0.63, photographs 0.77.
    sharp: float = 0.40
    # Time without any change after which a picture is frozen, not one delivered twice; over which pictures are compared
    # to detect a cover on a part of the lens; after which such a cover is a fault, and a robot at rest by pictures
    # alone.
    lasts_s: float = 1.0
    # Mean grey levels by which the scene changes as the robot, or something before it, moves; a sensor's noise of 5 a
    # pixel leaves 1.4.
    moved: float = 4.0
    # Of the tiles that stay as plain as `covered` and do not change while others do, or that become plain from one
    # picture to the next (half a picture covered has 0.35 to 0.40; walls that rendered robots pass have up to 0.35 for
    # a moment, HoloLens, lounge, RedKitchen, EuRoC, KITTI at most 0.04); and of the pixels that must not be saturated
    # (photographs: 0.35).
    part_share: float = 0.3


@dataclass(frozen=True, slots=True)
class PictureHealth:
    """blindness: why the picture is unusable, unchanged while that lasts; None for a usable picture. fault: in the
    frame where a condition begins. covered: unusable share of a usable picture.
    """

    blindness: Fault | None = None
    fault: Fault | None = None
    covered: float = 0.0

    @property
    def stale(self) -> bool:
        """Whether the picture equals the previous one; without sensor noise, also true for a robot at rest."""
        return self.blindness is not None and self.blindness.kind in (FaultKind.REPEATED, FaultKind.FROZEN)

    @property
    def blind(self) -> bool:
        """Whether the picture has no information."""
        return self.blindness is not None


class HealthMonitor:
    """Judges pictures one by one, on every second pixel of the green channel.

    Every fourth is compared with the picture before: a sensor's noise always changes some.
    """

    def __init__(self, rule: HealthRule | None = None) -> None:
        self._rule = rule or HealthRule()
        self._history: deque[tuple[float, MatLike, NDArray[np.uint8]]] = deque()
        self._covered, self._part_since_s = 0.0, math.inf  # share that is covered, and since when it is too much
        self._plain: NDArray[np.bool_] | None = None  # which tiles of the last picture are plain
        self._cover = np.zeros(TILES[::-1], dtype=np.bool_)  # what suddenly became plain, until lasts_s has passed
        self._last: NDArray[np.uint8] | None = None
        self._changed_s = -math.inf
        self._news, self._part_news = StreamTimer(REPEATED_S), StreamTimer(REPEATED_S)
        self._blindness: Fault | None = None  # of the last picture

    def judge(self, frame: Frame) -> PictureHealth:
        """The health of a frame's picture."""
        half = np.ascontiguousarray(frame.image[::2, ::2, 1])
        grid = np.ascontiguousarray(half[::2, ::2])
        last, self._last = self._last, grid
        changed = last is None or not np.array_equal(grid, last)
        if changed:
            self._changed_s = frame.stamp_s
        step = max(1, half.shape[1] // WORKING_WIDTH)
        small_size = half.shape[1] // step, max(1, half.shape[0] // step)
        small = cv2.resize(half, small_size, interpolation=cv2.INTER_AREA)
        fine = cv2.blur(small, (FINE_PX, FINE_PX))
        structure = cv2.absdiff(fine, cv2.blur(fine, (COARSE_PX, COARSE_PX)))
        kind, detail = _content(small, fine, structure, self._rule)
        if not kind and not changed:
            lasts = frame.stamp_s - self._changed_s >= self._rule.lasts_s
            kind = FaultKind.FROZEN if lasts else FaultKind.REPEATED
            detail = f"has not changed since {self._changed_s:.3f} s"
        elif not kind and last is not None and last.shape == grid.shape:
            kind, detail = _torn(grid, last, self._rule)
        health = self._reported(kind, detail, frame.stamp_s)
        return health if health.blind else self._covered_in_part(health, small, structure, frame.stamp_s)

    def _covered_in_part(
        self, health: PictureHealth, small: MatLike, structure: MatLike, stamp_s: float
    ) -> PictureHealth:
        """Health of a usable picture with the share that a cover hides, from the pictures of the last second."""
        rule, history, maxima = self._rule, self._history, _tile_maxima(structure)
        plain = maxima < rule.covered
        suddenly = self._plain is not None and float((plain & ~self._plain).mean()) >= rule.part_share
        self._plain = plain
        if suddenly:
            self._cover = plain
            history.clear()  # pictures from before the cover do not show it
        history.append((stamp_s, small, maxima))
        while len(history) > 1 and stamp_s - history[1][0] >= rule.lasts_s:
            history.popleft()
        if stamp_s - history[0][0] >= rule.lasts_s:
            changes = cv2.resize(cv2.absdiff(small, history[0][1]), TILES, interpolation=cv2.INTER_AREA)
            lasting = np.max([maxima for _, _, maxima in history], axis=0) < rule.covered
            self._cover = np.zeros_like(plain)
            if (changes >= rule.moved).any():  # at rest a cover cannot be detected
                self._covered = float((lasting & (changes < rule.moved)).mean())
        covered = max(self._covered, float((self._cover & plain).mean()))
        if covered >= rule.part_share:
            self._part_since_s = min(self._part_since_s, stamp_s)
        else:
            self._part_since_s = math.inf
            self._part_news.done()
        if stamp_s - self._part_since_s < rule.lasts_s or not self._part_news.due(stamp_s):
            return replace(health, covered=covered)
        text = f"picture covered in part ({100 * covered:.0f} % of it stays plain while the rest moves)"
        return replace(health, covered=covered, fault=Fault(FaultKind.COVERED_IN_PART, text))

    def _reported(self, kind: FaultKind | None, detail: str, stamp_s: float) -> PictureHealth:
        if kind is None:
            self._blindness = None
            return PictureHealth()
        if self._blindness is None or kind is not self._blindness.kind:
            self._blindness = Fault(kind, f"blind: picture {kind} ({detail})")
            self._news.done()
        news = kind is not FaultKind.REPEATED and self._news.due(stamp_s)
        return PictureHealth(self._blindness, self._blindness if news else None)


def _tile_maxima(values: MatLike) -> NDArray[np.uint8]:
    """Of each of TILES, (down, across); what is left over at the right and below does not count."""
    across, down = TILES
    if values.shape[0] < down or values.shape[1] < across:  # of a very small or narrow picture
        values = cv2.resize(values, (max(across, values.shape[1]), max(down, values.shape[0])))
    height, width = values.shape[0] // down, values.shape[1] // across
    rows = values[: height * down, : width * across].reshape(down, height, -1).max(axis=1)
    return rows.reshape(down, across, width).max(axis=2)


def _content(grey: MatLike, fine: MatLike, structure: MatLike, rule: HealthRule) -> tuple[FaultKind | None, str]:
    """Kind and detail by one picture's content alone; None where usable. fine, structure: without the finest and the
    coarsest."""
    shares = np.cumsum(cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel()) / grey.size
    left = float(shares[-1 - rule.covered - 1])
    if left < rule.part_share:
        return FaultKind.BLOWN, f"{100 * (1.0 - left):.0f} % of it saturated"
    coarse, bright = _percentile(structure), int(np.searchsorted(shares, 0.98))
    if coarse < rule.covered and bright < BLACK + rule.covered:
        return FaultKind.DARK, f"98 % of it at grey level {bright} or below"
    if coarse < rule.covered:
        return FaultKind.COVERED, f"contrast {coarse} grey levels: a covered lens, or a plain surface"
    sharpness = _percentile(cv2.absdiff(grey, fine)) / coarse
    if sharpness < rule.sharp:
        return FaultKind.BLURRED, f"sharpness {sharpness:.2f}, at least {rule.sharp:.2f} is needed"
    return None, ""


def _torn(grid: NDArray[np.uint8], last: NDArray[np.uint8], rule: HealthRule) -> tuple[FaultKind | None, str]:
    """Kind and detail where rows at one end are repeated or missing."""
    rows = len(grid)
    if (grid[-1] == MIDDLE_GREY).all():
        missing = _run((grid == MIDDLE_GREY).all(axis=1)[::-1])
        if missing > rows / TILES[1]:
            return FaultKind.TORN, f"{missing} of {rows} rows are missing"
    if (grid[0] == last[0]).all() or (grid[-1] == last[-1]).all():
        same = (grid == last).all(axis=1) & (np.ptp(grid, axis=1) > 0)  # bars and borders of one colour are no old rows
        top, bottom = _run(same), _run(same[::-1])
        old = max(top, bottom)
        moved = float(cv2.absdiff(grid[~same], last[~same]).mean())
        if old > rows / TILES[1] and moved > rule.moved:
            side = "top" if top >= bottom else "bottom"
            return FaultKind.TORN, f"{old} of {rows} rows at the {side} are the last picture's"
    return None, ""


def _run(flags: NDArray[np.bool_]) -> int:
    """Number of leading flags that are set."""
    return len(flags) if flags.all() else int(flags.argmin())


def _percentile(values: MatLike) -> int:
    counts = cv2.calcHist([values], [0], None, [256], [0, 256]).ravel()
    return int(np.searchsorted(np.cumsum(counts), PERCENTILE * values.size))


class Views:
    """Compares pictures with the last one that showed another view. moved: mean grey levels by which one differs, as
    of `HealthRule`."""

    def __init__(self, moved: float) -> None:
        self._moved = moved
        self._last: MatLike | None = None

    def is_another(self, grey: MatLike) -> bool:
        """Whether a grey picture of any size shows another view than the last one that did; the first one does."""
        coarse = cv2.resize(grey, VIEW_PX, interpolation=cv2.INTER_AREA)
        if self._last is not None and float(cv2.absdiff(coarse, self._last).mean()) < self._moved:
            return False
        self._last = coarse
        return True
