"""The mount from depth pictures: the floor's plane gives height, pitch and roll without any pattern. Up by gravity."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import FARTHEST_M, NEAREST_M, SparseDepth
from edgemap.geometry.camera.floor_plane import FloorPlane, find_floor
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import GRAVITY_M_S2
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, pitch_roll
from edgemap.geometry.robust import FEWEST, median_and_scatter
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M

EVERY_PX = 8  # between the depths that are read
WORST_HEIGHT_SHARE, WORST_TILT_RAD = 0.02, math.radians(0.5)  # one standard deviation
# From picture to picture, of a camera that is mounted. The roll of a carried one has a scatter of 2.5 to 3.6 degrees on
# the lounge, hololens and redkitchen walks, against 0.2 to 0.7 on tuning homes 9000-9005.
MAXIMUM_SCATTER_M, MAXIMUM_SCATTER_RAD = 0.03, math.radians(1.5)


@dataclass(frozen=True, slots=True)
class FloorDepthFit:
    """What came out. sigma: one standard deviation of height_m, pitch_rad, roll_rad, from the scatter between
    pictures. rms_m: of depth points about the floor. share: of all points, on the floor. pictures, looked_at: with a
    floor in them, and all."""

    mount: Mount
    sigma: tuple[float, float, float]
    rms_m: float
    share: float
    pictures: int
    examined: int

    def record(self) -> dict[str, Any]:
        """For camera.yaml's `calibration`."""
        return {
            "method": "floor in depth pictures",
            "pictures": self.pictures,
            "rms_m": round(self.rms_m, 5),
            "floor_share": round(self.share, 3),
            "sigma_height_m": round(self.sigma[0], 5),
            "sigma_pitch_deg": round(math.degrees(self.sigma[1]), 4),
            "sigma_roll_deg": round(math.degrees(self.sigma[2]), 4),
        }


def fit_floor_depth(
    pictures_m: Iterable[NDArray[np.float32]],
    lens: Intrinsics,
    up: Array | None = None,
    mounted: bool = True,
) -> FloorDepthFit:
    """The mount whose floor the depth pictures, (H, W) metres along the optical axis, show; NaN or 0 where unknown.

    lens: of these pictures. up: (3,) in the optical frame by gravity, where there is an IMU. Medians over the pictures.
    Raises CalibrationError with the numbers for too few pictures with a floor, for a lens outside 0.05 to 3 m, and,
    where the camera is `mounted` and not carried, for pictures that do not agree.
    """
    rng, examined = np.random.default_rng(0), 0
    planes: list[FloorPlane] = []
    for depth in pictures_m:
        examined += 1
        plane = find_floor(_points(depth, lens), rng, up)
        if plane is not None:
            planes.append(plane)
    if len(planes) < FEWEST:
        raise CalibrationError(
            f"{len(planes)} of {examined} depth pictures show a floor, need {FEWEST} or more: let the camera "
            f"see two square metres of free floor, {NEAREST_M:g} to {FARTHEST_M:g} m away"
        )
    values = np.array([(plane.height_m, *pitch_roll(plane.up)) for plane in planes])
    middle, scatter = median_and_scatter(values)
    if not LOWEST_M <= middle[0] <= HIGHEST_M:
        raise CalibrationError(
            f"{len(planes)} depth pictures put the floor {middle[0]:.3g} m below the lens, expected {LOWEST_M:g} to "
            f"{HIGHEST_M:g} m: which unit is the depth in?"
        )
    if mounted and (scatter[0] > MAXIMUM_SCATTER_M or scatter[1:].max() > MAXIMUM_SCATTER_RAD):
        raise CalibrationError(
            f"the floor lies {100 * scatter[0]:.1f} cm and {math.degrees(scatter[1:].max()):.1f} deg apart from "
            f"picture to picture, at most {100 * MAXIMUM_SCATTER_M:g} cm and "
            f"{math.degrees(MAXIMUM_SCATTER_RAD):g} deg: the camera must be mounted on the robot, and no table may "
            "hide the floor"
        )
    sigma = scatter / math.sqrt(len(planes))
    if mounted and (sigma[0] > WORST_HEIGHT_SHARE * middle[0] or sigma[1:].max() > WORST_TILT_RAD):
        raise CalibrationError(
            f"mount known to {100 * sigma[0]:.1f} cm and {math.degrees(sigma[1:].max()):.2f} deg only: more pictures"
        )
    rms_m = float(np.median([plane.rms_m for plane in planes]))
    share = float(np.median([plane.share for plane in planes]))
    height_m, pitch_rad, roll_rad = middle.tolist()
    mount, sigmas = Mount(height_m, pitch_rad, roll_rad), tuple(sigma.tolist())
    return FloorDepthFit(mount, sigmas, rms_m, share, len(planes), examined)


def _points(depth: NDArray[np.float32], lens: Intrinsics) -> Array:
    if depth.shape != (lens.height, lens.width):
        raise CalibrationError(
            f"depth picture of {depth.shape[1]}x{depth.shape[0]} px, the lens is for {lens.width}x{lens.height} px"
        )
    return SparseDepth.of(depth, EVERY_PX).points(lens)[0]


WINDOW_S = 0.5  # of samples of an accelerometer that are averaged
WORST_M_S2 = 1.0  # by which a window's mean may differ from gravity; a sensor's offset is 0.7


def gravity(samples: ImuSamples) -> Array | None:
    """Up, (3,) unit vector of the optical frame: the median over half seconds; None where samples are too few.

    Its accuracy is `inertial.OFFSET_RAD`: at rest an accelerometer's offset cannot be separated from a tilt.
    """
    if not len(samples):
        return None
    window = ((samples.stamps_s - samples.stamps_s[0]) / WINDOW_S).astype(int)
    counts = np.bincount(window)
    means = np.stack([np.bincount(window, samples.accel_m_s2[:, axis]) for axis in range(3)], axis=1)
    means = means[counts > 0] / counts[counts > 0, None]
    size = np.linalg.norm(means, axis=1)
    means = means[np.abs(size - GRAVITY_M_S2) < WORST_M_S2]
    if len(means) < FEWEST:
        return None
    middle = np.median(means, axis=0)
    return middle / np.linalg.norm(middle)
