"""A depth camera with intrinsics and pose different from the picture's, and its depth registered to the picture."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import NEAREST_M
from edgemap.geometry.camera.intrinsics import Intrinsics


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """Intrinsics of a depth camera and its pose in the optical frame of the picture's camera: rotation (3, 3) and
    position_m (3,) take its points into that frame."""

    intrinsics: Intrinsics
    rotation: Array = field(default_factory=lambda: np.eye(3))
    position_m: Array = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def _rays(self) -> NDArray[np.float32]:
        """Of all its pixels, (3, N), along the axes of the picture's camera."""
        v, u = np.mgrid[0 : self.intrinsics.height, 0 : self.intrinsics.width]
        rays = self.intrinsics.rays(np.column_stack([u.ravel(), v.ravel()])) @ self.rotation.T
        return np.ascontiguousarray(rays.T, dtype=np.float32)

    def registered(self, depth: NDArray[np.float32], lens: Intrinsics) -> NDArray[np.float32] | None:
        """Depth registered to the pixels of the picture's lens: (H, W) metres along its optical axis, 0 where unknown;
        None for a depth picture of another size. The nearest depth of a pixel counts, as in the picture."""
        sensor = self.intrinsics
        if depth.shape != (sensor.height, sensor.width):
            return None
        measured = np.flatnonzero(depth > 0.0)
        x, y, z = self._rays[:, measured] * depth.ravel()[measured] + self.position_m[:, None].astype(np.float32)
        ahead = np.flatnonzero(z > NEAREST_M)
        ideal, z = np.stack([x[ahead], y[ahead]], axis=1) / z[ahead, None], z[ahead]
        distorted = ideal if lens.distortion.is_identity else lens.distortion.distort(ideal.astype(np.float64))
        columns, rows = distorted[:, 0] * lens.fx + lens.cx, distorted[:, 1] * lens.fy + lens.cy
        nearest = np.full(lens.height * lens.width, np.inf, dtype=np.float32)
        # A pixel of the depth picture covers as many of the picture's, or these would have holes.
        wide, high = math.ceil(lens.fx / sensor.fx - 1e-6), math.ceil(lens.fy / sensor.fy - 1e-6)
        for across in range(wide):
            for down in range(high):
                u, v = np.rint(columns + across - (wide - 1) / 2.0), np.rint(rows + down - (high - 1) / 2.0)
                inside = (u >= 0.0) & (u < lens.width) & (v >= 0.0) & (v < lens.height)
                at = v[inside].astype(np.intp) * lens.width + u[inside].astype(np.intp)
                np.minimum.at(nearest, at, z[inside])
        nearest[np.isinf(nearest)] = 0.0
        return nearest.reshape(lens.height, lens.width)
