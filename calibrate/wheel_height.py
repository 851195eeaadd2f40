"""The lens's height from wheels: the floor passes as much faster as the lens is lower."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from edgemap.calibrate.guess_sizes import USUAL_HEIGHT_M
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.robust import FEWEST, median_and_scatter
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CalibrationError, OdometryError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import PoseTrack
from edgemap.runtime.motion.odometry.window import WindowOdometry

WINDOW_M, MAXIMUM_YAW_RAD = 0.3, math.radians(15.0)  # of nearly straight travel, of which both ends are compared
WORST_SHARE = 0.05  # one standard deviation of the mean


@dataclass(frozen=True, slots=True)
class WheelHeight:
    """height_m with one standard deviation, from so many windows over travelled_m by the wheels."""

    height_m: float
    sigma_m: float
    windows: int
    travelled_m: float


def fit_wheel_height(frames: Iterable[Frame], wheels: PoseTrack, lens: Intrinsics, mount: Mount) -> WheelHeight:
    """The height at which the pictures travel as far as the wheels did. mount: its angles and lever arm count.

    Raises CalibrationError with the numbers where too little was travelled, or the ratio scatters.
    """
    # The odometry begins with a usual height, and its motion scales with it.
    guess = Mount(USUAL_HEIGHT_M, mount.pitch_rad, mount.roll_rad, mount.forward_m, mount.left_m)
    odometry = WindowOdometry(FloorCamera(lens, guess))
    ratios: list[float] = []
    travelled_m, seen, start = 0.0, SE2(), None
    for frame in frames:
        motion = odometry.step(frame, {})
        try:
            here = wheels.at(frame.stamp_s)
        except OdometryError:
            start = None
            continue
        if start is None or not motion.measured:
            start, seen = here, SE2()
            continue
        seen = seen @ motion.motion
        rolled = start.inverse() @ here
        rolled_m = math.hypot(rolled.x_m, rolled.y_m)
        if rolled_m < WINDOW_M and abs(rolled.yaw_rad) < MAXIMUM_YAW_RAD:
            continue
        if abs(rolled.yaw_rad) < MAXIMUM_YAW_RAD:
            ratios.append(rolled_m / max(math.hypot(seen.x_m, seen.y_m), 1e-3))
            travelled_m += rolled_m
        start, seen = here, SE2()
    if len(ratios) < FEWEST:
        raise CalibrationError(
            f"the wheels rolled {travelled_m:.1f} m straight on with a floor in view, need "
            f"{FEWEST * WINDOW_M:g} m or more: drive on, or pass --height METRES"
        )
    middle, scatter = map(float, median_and_scatter(ratios))
    sigma = scatter / math.sqrt(len(ratios))
    if sigma > WORST_SHARE * middle:
        raise CalibrationError(
            f"wheels and floor give the height to {100 * sigma / middle:.0f} % only, expected {100 * WORST_SHARE:g} %: "
            "drive on a floor with texture, or pass --height METRES"
        )
    return WheelHeight(USUAL_HEIGHT_M * middle, USUAL_HEIGHT_M * sigma, len(ratios), travelled_m)
