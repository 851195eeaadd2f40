"""The pinhole camera with lens distortion: pixels to rays and back, on numpy alone."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import GeometryError

# By how much numbers may be off that are a lens's: the middle, as a share of the picture's width or height (a tenth at
# most; exchanged numbers a sixth, those of half the size a quarter), and fx / fy from 1, as logarithm.
DOUBTFUL = 0.15
# Models and how many coefficients they have.
DISTORTION_MODELS = {
    "none": 5, "brown_conrady": 5, "inverse_brown_conrady": 5, "modified_brown_conrady": 5, "rational": 8,
    "equidistant": 4,
}  # fmt: skip
# What other programs call them (ROS, OpenCV, Kalibr, COLMAP), in small letters and digits alone.
OTHER_NAMES = {
    **dict.fromkeys(("", "none", "pinhole"), "none"),
    **dict.fromkeys(("plumbbob", "radtan", "radialtangential", "brownconrady", "opencv"), "brown_conrady"),
    **dict.fromkeys(("rationalpolynomial", "rational", "fullopencv"), "rational"),
    **dict.fromkeys(("equidistant", "equi", "fisheye", "opencvfisheye"), "equidistant"),
    **dict.fromkeys(("kannalabrandt", "kannalabrandt4", "kannalabrandt8"), "equidistant"),
}
STEEPEST_RAD = math.radians(89.0)  # between a ray and the optical axis: points at unit depth end at 90


@dataclass(frozen=True, slots=True)
class Distortion:
    """Lens distortion: `model` and its coefficients (k1, k2, p1, p2, k3, k4, k5, k6), missing ones zero.

    - `none`
    - `brown_conrady`: OpenCV's five-parameter model.
    - `modified_brown_conrady`: RealSense's; tangential terms see the radially scaled point.
    - `inverse_brown_conrady`: what RealSense colour streams report. The name promises the opposite direction, but
      librealsense (2.59, `rs2_project_point_to_pixel`, `rs2_deproject_pixel_to_point`) computes it like
      `modified_brown_conrady`, and so do we: tests compare with librealsense itself.

    - `rational`: OpenCV's with k4, k5, k6 in the denominator.
    - `equidistant`: OpenCV's fisheye (Kannala-Brandt) with (k1, k2, k3, k4), a distortion even where all are zero; rays
      end 89 degrees from the axis.

    In all of them the polynomial takes ideal to distorted points.
    Raises GeometryError for an unknown model, too many coefficients, or one that is not finite.
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model not in DISTORTION_MODELS:
            raise GeometryError(f"distortion model {self.model!r} is not one of {', '.join(DISTORTION_MODELS)}")
        coefficients = tuple(float(c) for c in self.coefficients)
        if len(coefficients) > DISTORTION_MODELS[self.model]:
            raise GeometryError(
                f"distortion {self.model} has {len(coefficients)} coefficients, at most {DISTORTION_MODELS[self.model]}"
            )
        if not all(map(math.isfinite, coefficients)):
            raise GeometryError(f"distortion coefficients {list(coefficients)} are not all finite")
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def named(cls, name: str, coefficients: Sequence[float]) -> "Distortion":
        """The model of another program's name, which counts even where the coefficients are zero. Raises GeometryError
        for one that is not supported, with its name."""
        model = OTHER_NAMES.get(re.sub(r"[^a-z0-9]", "", name.lower()))
        values = [float(value) for value in coefficients]
        if model in ("brown_conrady", "rational"):
            model = "rational" if any(values[5:]) else "brown_conrady" if any(values) else "none"
        known = 0 if model is None or model == "none" else DISTORTION_MODELS[model]
        if model is None or any(values[known:]):
            raise GeometryError(f"distortion {name[:40]!r} with {len(values)} coefficients is not supported")
        return cls(model, tuple(values[:known]) if any(values) else ())

    @property
    def is_identity(self) -> bool:
        """True where points pass unchanged."""
        return self.model == "none" or (self.model != "equidistant" and not any(self.coefficients))

    def distort(self, points: Array) -> Array:
        """Ideal to distorted normalised image points, shape (N, 2), no unit."""
        if self.is_identity:
            return points
        x, y = points[:, 0], points[:, 1]
        r2 = x * x + y * y
        if self.model == "equidistant":
            distance = np.sqrt(r2)
            return points * (self._of_angle(np.arctan(distance)) / np.maximum(distance, 1e-12))[:, None]
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * 8)[:8]
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if self.model == "rational":
            radial = radial / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        xr, yr = x * radial, y * radial
        if self.model in ("inverse_brown_conrady", "modified_brown_conrady"):
            x, y = xr, yr
        return np.stack(
            [xr + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), yr + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y], axis=1
        )

    def undistort(self, points: Array) -> Array:
        """Distorted to ideal normalised image points, shape (N, 2), by Newton's method."""
        if self.is_identity:
            return points
        return self._undistorted_fisheye(points) if self.model == "equidistant" else _invert(self.distort, points)

    def _of_angle(self, angle: Array) -> Array:
        """Distance from the middle of the picture by the angle to the optical axis, rad."""
        k1, k2, k3, k4 = (*self.coefficients, 0.0, 0.0, 0.0, 0.0)[:4]
        a2 = angle * angle
        return angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))

    def _undistorted_fisheye(self, points: Array) -> Array:
        distance = np.hypot(points[:, 0], points[:, 1])
        angle = np.minimum(distance, STEEPEST_RAD)
        for _ in range(20):
            slope = (self._of_angle(angle + 1e-6) - self._of_angle(angle - 1e-6)) / 2e-6
            step = (self._of_angle(angle) - distance) / np.maximum(slope, 1e-3)
            angle = np.clip(angle - np.clip(step, -0.5, 0.5), 0.0, STEEPEST_RAD)
        return points * (np.tan(angle) / np.maximum(distance, 1e-12))[:, None]


def _invert(function: Callable[[Array], Array], targets: Array) -> Array:
    """Solve function(x) = target per row by Newton's method with a numeric 2x2 Jacobian, starting at the target."""
    points, h = targets.copy(), 1e-6
    for _ in range(20):
        residual = function(points) - targets
        if np.abs(residual).max(initial=0.0) < 1e-12:
            break
        dx = (function(points + [h, 0.0]) - function(points - [h, 0.0])) / (2 * h)
        dy = (function(points + [0.0, h]) - function(points - [0.0, h])) / (2 * h)
        determinant = _cross(dx, dy)
        determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
        step = np.column_stack([_cross(residual, dy), _cross(dx, residual)]) / determinant[:, None]
        points = points - np.clip(step, -0.5, 0.5)
    return points


def _cross(one: Array, other: Array) -> Array:
    """Cross products of vectors (N, 2)."""
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


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
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            value, kind = getattr(self, name), "finite" if name in ("cx", "cy") else "positive"
            if not math.isfinite(value) or (kind == "positive" and value <= 0):
                raise GeometryError(f"intrinsics: {name} is {value}, must be a {kind} number of pixels")

    @property
    def off_picture(self) -> bool:
        """Whether the principal point lies outside the picture."""
        return not (-0.5 <= self.cx <= self.width - 0.5 and -0.5 <= self.cy <= self.height - 0.5)

    @property
    def doubt(self) -> str | None:
        """Why the numbers may be those of another picture size or in another order; None where nothing shows it."""
        off_x, off_y = abs(self.cx - self.width / 2) / self.width, abs(self.cy - self.height / 2) / self.height
        if max(off_x, off_y) > DOUBTFUL:
            return (
                f"the principal point {self.cx:g},{self.cy:g} is far from the middle of {self.width}x{self.height} px: "
                "are these numbers for pictures of another size?"
            )
        if abs(math.log(self.fx / self.fy)) > DOUBTFUL:
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

    def fitted(self, width: int, height: int) -> "Intrinsics":
        """The same camera for pictures of that size, where the ratio of the sides is the same. Raises GeometryError
        with both sizes."""
        if (width, height) == (self.width, self.height):
            return self
        if width * self.height != height * self.width:
            raise GeometryError(f"intrinsics are for {self.width}x{self.height} px, the pictures {width}x{height} px")
        return self.scaled(width, height)

    def rotated(self, degrees: int) -> "Intrinsics":
        """The same camera for pictures turned clockwise by 90, 180 or 270 degrees."""
        if degrees % 360 == 0:
            return self
        k1, k2, p1, p2, *rest = (*self.distortion.coefficients, 0.0, 0.0, 0.0, 0.0)[
            : max(len(self.distortion.coefficients), 4)
        ]
        turned = (k1, k2, p1, p2) if self.distortion.model == "equidistant" else (k1, k2, p2, -p1)
        coefficients = (*turned, *rest) if self.distortion.coefficients else ()
        distortion = Distortion(self.distortion.model, coefficients)
        middle = self.height - 1.0 - self.cy, self.cx
        return Intrinsics(self.height, self.width, self.fy, self.fx, *middle, distortion).rotated(degrees - 90)

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
