"""The floor in a mounted camera's picture: horizon, ray-floor intersection, and error propagation to the floor."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.intrinsics import STEEPEST_RAD, Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount, rotation_base_optical
from edgemap.geometry.errors import GeometryError

FARTHEST_HEIGHTS = 20.0  # maximum range of the nearest visible floor; 3 degrees below the horizon, boxes give no range


@dataclass(frozen=True, slots=True)
class FloorCamera:
    """A camera on its mount, looking at the plane z = 0 of the base frame.

    attitude: attitude of one frame, if `mount` is the mount of that frame (see `at`); None for a level robot.
    Raises GeometryError if no picture row of a level robot shows the floor (the camera looks at the sky).
    """

    intrinsics: Intrinsics
    mount: Mount
    attitude: Attitude | None = None

    def __post_init__(self) -> None:
        if self.attitude is not None:
            return
        bottom = [(u, self.intrinsics.height - 1.0) for u in (0.0, self.intrinsics.cx, self.intrinsics.width - 1.0)]
        rays = self.rays_base(bottom)
        falls = -rays[:, 2] / np.maximum(np.linalg.norm(rays[:, :2], axis=1), 1e-9)
        if falls.max() * FARTHEST_HEIGHTS < 1.0:
            pitch_deg = math.degrees(self.mount.pitch_rad)
            half_deg = math.degrees(math.atan2(self.intrinsics.height - 1.0 - self.intrinsics.cy, self.intrinsics.fy))
            raise GeometryError(
                f"mount: pitch {pitch_deg:.1f} deg (positive is down) with {half_deg:.1f} deg of view below the "
                f"optical axis sees no floor within {FARTHEST_HEIGHTS:g} camera heights; the camera looks at the sky"
            )

    def at(self, attitude: Attitude) -> "FloorCamera":
        """The camera of one frame. Pitch, roll and, if estimated, height are those of the frame; all other values are
        those of the mount.
        """
        pitch, roll = np.clip([attitude.pitch_rad, attitude.roll_rad], -STEEPEST_RAD, STEEPEST_RAD).tolist()
        height_m = self.mount.height_m if attitude.height_m is None else max(attitude.height_m, 0.02)  # never below
        mount = replace(self.mount, pitch_rad=pitch, roll_rad=roll, height_m=height_m)
        return replace(self, mount=mount, attitude=attitude)

    def rays_base(self, pixels: ArrayLike) -> Array:
        """Directions (N, 3) of the viewing rays through pixels (N, 2), in the base frame, not normalised."""
        return self.intrinsics.rays(pixels) @ self.mount.rotation_base_optical().T

    def below_horizon(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Whether each pixel (N, 2) lies below the horizon, (N,). It shows the floor unless it is occluded."""
        return self.rays_base(pixels)[:, 2] < -1e-9

    def floor_points(self, pixels: ArrayLike) -> Array:
        """Intersections of the rays through pixels (N, 2) with the floor: (N, 2), base frame, metres; NaN at or above
        the horizon.

        With zero roll, and in the column of the optical axis, this is the paper's equation 3.
        """
        mount = self.mount
        return on_floor(self.intrinsics.rays(pixels), mount.rotation_base_optical(), mount.position_base_m())

    def project(self, points_base_m: ArrayLike) -> Array:
        """Projects points (N, 3), or (N, 2) on the floor, base frame, to pixels (N, 2); NaN behind the camera."""
        points = np.asarray(points_base_m, dtype=np.float64)
        if points.shape[-1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        optical = (points - self.mount.position_base_m()) @ self.mount.rotation_base_optical()
        return self.intrinsics.project(optical)

    def horizon_row(self, column_px: float | None = None) -> float:
        """The paper's h_t: the row, px, where a picture column (default: the principal point's) meets the horizon.

        It is computed from the viewing rays, so it includes roll and lens distortion. It may lie outside the picture.
        """
        column = self.intrinsics.cx if column_px is None else column_px
        height = self.intrinsics.height
        if not self.intrinsics.distortion.is_identity:
            rows = np.linspace(0.0, height - 1.0, 257)
            z = self.rays_base(np.column_stack([np.full_like(rows, column), rows]))[:, 2]
            first = int((z < 0.0).argmax())
            if first > 0:
                return float(np.interp(0.0, -z[first - 1 : first + 1], rows[first - 1 : first + 1]))
        # Without distortion, as also for a row outside the picture, z is linear in the row.
        plain = replace(self, intrinsics=replace(self.intrinsics, distortion=Distortion()))
        z_top, z_bottom = plain.rays_base([(column, 0.0), (column, height)])[:, 2]
        return float(height * z_top / (z_top - z_bottom))

    def optical_depth_m(self, points_base_m: ArrayLike) -> Array:
        """Depth of floor points (N, 2), base frame, along the optical axis, metres, (N,). It scales sizes (eq. 4)."""
        points = np.asarray(points_base_m, dtype=np.float64).reshape(-1, 2)
        offsets = np.column_stack([points, np.zeros(len(points))]) - self.mount.position_base_m()
        return offsets @ self.mount.rotation_base_optical()[:, 2]


@dataclass(frozen=True, slots=True)
class FloorNoise:
    """Standard deviations of the mount: tilt_rad of its roll and of its pitch, and its height. All sightings of a drive
    share the resulting error."""

    tilt_rad: float = math.radians(0.5)
    height_m: float = 0.01


def floor_covariances(
    camera: FloorCamera, pixels: ArrayLike, sigmas_px: ArrayLike, noise: FloorNoise
) -> tuple[Array, Array]:
    """First-order covariances of floor points, base frame, m^2, (N, 2, 2) each.

    The first covariance is due to one frame: its pixels and its attitude. The second is due to the mount; all
    observations of a drive share it. pixels, sigmas_px: (N, 2), position and standard deviation, across and down.
    Computed with central differences; NaN at or above the horizon.
    """
    pixels, mount = np.asarray(pixels, dtype=np.float64).reshape(-1, 2), camera.mount
    variance_px2 = np.asarray(sigmas_px, dtype=np.float64).reshape(-1, 2, 1, 1) ** 2
    halves = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5], [0.0, 0.0]])
    around = pixels + halves[:, None]  # all five in one call: the lens model is the most expensive part
    rays = camera.intrinsics.rays(around.reshape(-1, 2))
    lens = mount.position_base_m()
    points = on_floor(rays, mount.rotation_base_optical(), lens).reshape(len(halves), -1, 2)
    right, left, below, above, here = points
    wrt_u, wrt_v = right - left, below - above
    from_pixels = variance_px2[:, 0] * _outer(wrt_u) + variance_px2[:, 1] * _outer(wrt_v)
    middle, step_rad = rays[-len(pixels) :], 1e-4

    def moved(pitch_rad: float, roll_rad: float) -> Array:
        return on_floor(middle, rotation_base_optical(mount.pitch_rad + pitch_rad, mount.roll_rad + roll_rad), lens)

    wrt_roll = (moved(0.0, step_rad) - moved(0.0, -step_rad)) / (2.0 * step_rad)
    wrt_pitch = (moved(step_rad, 0.0) - moved(-step_rad, 0.0)) / (2.0 * step_rad)
    wrt_height = (here - lens[:2]) / mount.height_m
    from_mount = noise.tilt_rad**2 * (_outer(wrt_roll) + _outer(wrt_pitch)) + noise.height_m**2 * _outer(wrt_height)
    if camera.attitude is not None:
        wrt_attitude = np.stack([wrt_roll, wrt_pitch], axis=-1)
        from_pixels = from_pixels + wrt_attitude @ camera.attitude.covariance_rad2 @ wrt_attitude.transpose(0, 2, 1)
    return from_pixels, from_mount


def on_floor(rays_optical: Array, rotation: Array, lens: Array) -> Array:
    """Intersections (N, 2) of rays (N, 3) from the lens, (3,), with the floor, base frame; NaN if there is none."""
    rays = rays_optical @ rotation.T
    down = np.where(rays[:, 2] < -1e-9, -rays[:, 2], np.nan)
    return lens[:2] + rays[:, :2] * (lens[2] / down)[:, None]


def _outer(vectors: Array) -> Array:
    return vectors[:, :, None] * vectors[:, None, :]
