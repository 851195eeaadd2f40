"""The lens's height from wheels: the floor passes as much faster as the lens is lower."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from edgemap.calibrate.guess_sizes import USUAL_HEIGHT_M
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.robust import FEWEST, median_and_scatter
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.height_check import HeightRule, TravelWindows
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.slam import build_slam

WINDOW_M = 0.5  # of travel, over which wheels and pictures are compared
WORST_SHARE = 0.05  # one standard deviation of the mean


@dataclass(frozen=True, slots=True)
class WheelHeight:
    """height_m with one standard deviation, the wheels' radius included, from so many windows over travelled_m by the
    wheels."""

    height_m: float
    sigma_m: float
    windows: int
    travelled_m: float


def fit_wheel_height(
    source: Camera, frames: Iterable[Frame], bundle: Bundle, lens: Intrinsics, mount: Mount
) -> WheelHeight:
    """The height at which the pictures of a run travel as far as its wheels did. source: whose frames these are, with
    wheels. bundle: shows the floor. mount: its angles and lever arm count.

    Raises CalibrationError with the numbers where too little was travelled, or the ratio scatters.
    """
    # The run begins with a usual height, and its motion by pictures scales with it.
    guess = FloorCamera(lens, replace(mount, height_m=USUAL_HEIGHT_M))
    pipeline = build_slam(source, bundle, guess).pipeline
    travel = TravelWindows(WINDOW_M)
    for frame in frames:
        travel.add(pipeline.step(frame).motion.lengths)
    ratios, travelled_m = travel.ratios, sum(abs(rolled_m) for _, rolled_m in travel.windows)
    if len(ratios) < FEWEST:
        raise CalibrationError(
            f"the wheels rolled {travelled_m:.1f} m with a floor in view, need "
            f"{FEWEST * WINDOW_M:g} m or more: drive on, or pass --height METRES"
        )
    middle, scatter = map(float, median_and_scatter(ratios))
    share = scatter / math.sqrt(len(ratios)) / middle
    if not 0.0 <= share <= WORST_SHARE:
        raise CalibrationError(
            f"wheels and floor give the height to {100 * abs(share):.0f} % only, expected {100 * WORST_SHARE:g} %: "
            "drive on a floor with texture, or pass --height METRES"
        )
    height_m = USUAL_HEIGHT_M * middle
    return WheelHeight(height_m, math.hypot(share, HeightRule().wheels_sigma) * height_m, len(ratios), travelled_m)
