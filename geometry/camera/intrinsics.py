"""The pinhole camera with lens distortion: pixels to rays and back, on numpy alone."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import GeometryError

# Of the picture's width or height: lenses are a tenth off at most, exchanged numbers a sixth, those of half the size a
# quarter.
OFF_MIDDLE = 0.15
UNEQUAL = 0.15  # logarithm of fx / fy: pixels are square to some per cent
DISTORTION_MODELS = ("none", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady")


@dataclass(frozen=True, slots=True)
class Distortion:
    """Lens distortion: `model` and its coefficients (k1, k2, p1, p2, k3), missing ones zero.

    - `none`
    - `brown_conrady`: OpenCV's five-parameter model.
    - `modified_brown_conrady`: RealSense's; tangential terms see the radially scaled point.
    - `inverse_brown_conrady`: what RealSense colour streams report. The name promises the opposite direction, but
      librealsense (2.59, `rs2_project_point_to_pixel`, `rs2_deproject_pixel_to_point`) computes it like
      `modified_brown_conrady`, and so do we: tests compare with librealsense itself.

    In all of them the polynomial takes ideal to distorted points.
    Raises GeometryError for an unknown model, more than five coefficients, or one that is not finite.
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model not in DISTORTION_MODELS:
            raise GeometryError(f"distortion model {self.model!r} is not one of {', '.join(DISTORTION_MODELS)}")
        coefficients = tuple(float(c) for c in self.coefficients)
        if len(coefficients) > 5:
            raise GeometryError(
                f"distortion has {len(coefficients)} coefficients; edgemap knows five (k1, k2, p1, p2, k3)"
            )
        if not all(map(math.isfinite, coefficients)):
            raise GeometryError(f"distortion coefficients {list(coefficients)} are not all finite")
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def is_identity(self) -> bool:
        """True where points pass unchanged."""
        return self.model == "none" or not any(self.coefficients)

    def distort(self, points: Array) -> Array:
        """Ideal to distorted normalised image points, shape (N, 2), no unit."""
        if self.is_identity:
            return points
        return self._polynomial(points)

    def undistort(self, points: Array) -> Array:
        """Distorted to ideal normalised image points, shape (N, 2), by Newton's method."""
        if self.is_identity:
            return points
        return _invert(self._polynomial, points)

    def _polynomial(self, points: Array) -> Array:
        k1, k2, p1, p2, k3 = (*self.coefficients, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        x, y = points[:, 0], points[:, 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xr, yr = x * radial, y * radial
        if self.model != "brown_conrady":
            x, y = xr, yr
        return np.stack(
            [xr + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), yr + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y], axis=1
        )


def _invert(function: Callable[[Array], Array], targets: Array) -> Array:
    """Solve function(x) = target per row by Newton's method with a numeric 2x2 Jacobian, starting at the target."""
    points, h = targets.copy(), 1e-6
    for _ in range(20):
        residual = function(points) - targets
        if np.abs(residual).max(initial=0.0) < 1e-12:
            break
        dx = (function(points + [h, 0.0]) - function(points - [h, 0.0])) / (2 * h)
        dy = (function(points + [0.0, h]) - function(points - [0.0, h])) / (2 * h)
        determinant = dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]
        determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
        step = np.stack(
            [
                (residual[:, 0] * dy[:, 1] - residual[:, 1] * dy[:, 0]) / determinant,
                (residual[:, 1] * dx[:, 0] - residual[:, 0] * dx[:, 1]) / determinant,
            ],
            axis=1,
        )
        points = points - np.clip(step, -0.5, 0.5)
    return points


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A calibrated camera: image size and focal lengths in pixels, principal point in pixel coordinates.

    A pixel's integer coordinates are its centre, as in OpenCV. Optical frame: x right, y down, z forward.
    Raises GeometryError for sizes or focal lengths that are not finite and positive.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion = field(default_factory=Distortion)

    def __post_init__(self) -> None:
        for name in ("width", "height", "fx", "fy"):
            value = getattr(self, name)
            if not math.isfinite(value) or value <= 0:
                raise GeometryError(f"intrinsics: {name} is {value}, must be a positive number of pixels")
        for name in ("cx", "cy"):
            if not math.isfinite(getattr(self, name)):
                raise GeometryError(f"intrinsics: {name} is {getattr(self, name)}, must be a finite number of pixels")

    @property
    def off_picture(self) -> bool:
        """Whether the principal point lies outside the picture."""
        return not (-0.5 <= self.cx <= self.width - 0.5 and -0.5 <= self.cy <= self.height - 0.5)

    @property
    def doubt(self) -> str | None:
        """Why the numbers may be those of another picture size or in another order; None where nothing shows it."""
        off_x, off_y = abs(self.cx - self.width / 2) / self.width, abs(self.cy - self.height / 2) / self.height
        if max(off_x, off_y) > OFF_MIDDLE:
            return (
                f"the principal point {self.cx:g},{self.cy:g} is far from the middle of {self.width}x{self.height} px: "
                "are these numbers for pictures of another size?"
            )
        if abs(math.log(self.fx / self.fy)) > UNEQUAL:
            return f"the focal lengths {self.fx:g} and {self.fy:g} px are not alike: is the order fx, fy, cx, cy?"
        return None

    def rays(self, pixels: ArrayLike) -> Array:
        """Viewing rays through pixels, (N, 2) in px to (N, 3) in the optical frame with z = 1."""
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        ideal = self.distortion.undistort((pixels - [self.cx, self.cy]) / [self.fx, self.fy])
        return np.column_stack([ideal, np.ones(len(ideal))])

    def project(self, points_optical_m: ArrayLike) -> Array:
        """Points of the optical frame, (N, 3) in metres, to pixels (N, 2); NaN for points at or behind the camera."""
        points = np.asarray(points_optical_m, dtype=np.float64).reshape(-1, 3)
        depth = np.where(points[:, 2] > 1e-9, points[:, 2], np.nan)
        ideal = points[:, :2] / depth[:, None]
        ahead = np.isfinite(ideal).all(axis=1)
        pixels = np.full((len(points), 2), np.nan)
        pixels[ahead] = self.distortion.distort(ideal[ahead]) * [self.fx, self.fy] + [self.cx, self.cy]
        return pixels

    def scaled(self, width: int, height: int) -> "Intrinsics":
        """The same camera at another image size; scaling is about pixel centres, so the border keeps its angle."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )
