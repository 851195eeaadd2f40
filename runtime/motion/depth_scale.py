"""Judges the scale of depth pictures by the floor in them, whose height below the lens the mount states."""

import math
from collections import deque

import numpy as np

from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import HeightEstimate
from edgemap.geometry.grid.floor_scan import EDGE
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.runtime.frames.faults import Fault, FaultKind

PICTURES, KEPT = 10, 100  # with floor, before depth is judged; the latest ones that are
POINTS = 50  # of the floor in a picture that counts
FARTHEST_M = 40.0  # 8 m at five times their length
LEAST_M = 1e-3
LOWEST = 98.0  # percentile of the heights of all points in a picture: beyond are reflections
SOME = 90.0  # percentile over pictures: in a tenth of those with floor, the lowest point is the floor


class DepthScale:
    """Call `judge` with every picture that was searched. wrong: whether depth is left out from now on. fit: whether the
    map may rest on it: not before it was judged, or twice as many pictures showed too little floor. share: least
    relative error that is one of depth; smaller ones may be the mount's, which `HeightCheck` reports.

    Depth is too long where what looks like floor lies too low, and too short where nothing lies as low as the floor:
    what looks like floor may be a table.
    """

    def __init__(self, stated_m: float, share: float) -> None:
        self._stated_m, self._log_share, self.wrong = stated_m, math.log1p(share), False
        self._logs = deque[tuple[float, float]](maxlen=KEPT)  # of what looks like floor, and of the lowest
        self._pictures = 0  # with depth

    @property
    def fit(self) -> bool:
        """See the class."""
        return not self.wrong and (len(self._logs) >= PICTURES or self._pictures >= 2 * PICTURES)

    def judge(
        self, depth: SparseDepth | None, floor: FloorMask | None, camera: FloorCamera, estimate: HeightEstimate | None
    ) -> Fault | None:
        """The fault with which depth is left out. camera: of the frame. estimate: of the lens's height by other
        sensors: where it agrees with depth, the mount is wrong."""
        self._pictures += depth is not None
        if depth is None or floor is None or self.wrong:
            return None
        points, pixels = depth.points(camera.intrinsics, FARTHEST_M)
        below_m = np.maximum(-(points @ camera.mount.rotation_base_optical()[2]), LEAST_M)
        on_floor = below_m[floor.at(pixels) > EDGE]
        if len(on_floor) < POINTS:
            return None
        seen_m = float(np.median(on_floor)), float(np.percentile(below_m, LOWEST))
        self._logs.append((math.log(seen_m[0] / self._stated_m), math.log(seen_m[1] / self._stated_m)))
        logs = np.array(self._logs)
        usual, lowest = float(np.median(logs[:, 0])), float(np.percentile(logs[:, 1], SOME))
        off = usual if usual > self._log_share else lowest if lowest < -self._log_share else 0.0
        if len(logs) < PICTURES or not off:
            return None
        ratio = math.exp(off)
        if estimate and (estimate.height_m > self._stated_m * math.sqrt(ratio)) == (ratio > 1.0):
            return None
        self.wrong = True
        found = f"{ratio * self._stated_m:.2f} m below the lens, {ratio:.2f} of the {self._stated_m:.2f} m stated"
        text = f"depth: its floor lies {found}: left out (another unit, or another height of the lens?)"
        return Fault(FaultKind.DEPTH_EXCLUDED, text)
