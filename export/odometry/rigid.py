"""Where a moving base makes points of the picture go, and the motion that explains what was seen: least squares.

Everything is in normalised image points ("bearings") of cells on a grid, so that one network serves any lens and mount.
Batches: B pictures, N cells. The unknowns are the base's motion since the previous frame (x m, y m, yaw rad) and how
much the camera tilted on its springs meanwhile (roll, pitch, rad).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

LEAST_DEPTH = 0.05  # of a point before the previous camera, relative to its depth now
TILT_SIGMA_RAD = 0.006  # of the camera on its mount from one frame to the next


@dataclass(frozen=True, slots=True)
class Cells:
    """Constant geometry, as `geometry.flow_cells` gives it, flattened. here: bearings (B, 2, N). right, down: change of
    the bearing per cell, (B, 2, N). floor: inverse depth of the floor, 1/m, (B, 1, N). shown: 0 or 1, (B, 1, N).
    rotation: base from optical, (B, 3, 3). lens: in the base frame, m, (B, 3, 1)."""

    here: Tensor
    right: Tensor
    down: Tensor
    floor: Tensor
    shown: Tensor
    rotation: Tensor
    lens: Tensor

    @staticmethod
    def of(cells: Tensor, mount: Tensor) -> Cells:
        """cells: (B, 8, H, W). mount: (B, 12)."""
        flat = cells.flatten(2)
        here, right, down, floor, shown = flat.split([2, 2, 2, 1, 1], dim=1)
        rotation, lens = mount[:, :9].reshape(-1, 3, 3), mount[:, 9:].reshape(-1, 3, 1)
        return Cells(here, right, down, floor, shown, rotation, lens)

    def bearings_of(self, cells_moved: Tensor) -> Tensor:
        """Displacements in cells (right, down), (B, 2, N), as displacements of the bearing, to first order."""
        return self.right * cells_moved[:, :1] + self.down * cells_moved[:, 1:]

    def cells_of(self, bearings: Tensor) -> Tensor:
        """Displacements of the bearing as displacements in cells, (B, 2, N); 0 where nothing is shown."""
        determinant = self.right[:, :1] * self.down[:, 1:] - self.right[:, 1:] * self.down[:, :1]
        determinant = determinant + (1.0 - self.shown)
        across = (bearings[:, :1] * self.down[:, 1:] - bearings[:, 1:] * self.down[:, :1]) / determinant
        along = (bearings[:, 1:] * self.right[:, :1] - bearings[:, :1] * self.right[:, 1:]) / determinant
        return torch.cat([across, along], dim=1) * self.shown


def seen_before(cells: Cells, inverse_depth: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Bearings in the previous picture of what the cells show now, (B, 2, N), and their derivatives (B, 2, 5, N).

    inverse_depth: along the optical axis now, 1/m, (B, 1, N). motion: (B, 3), of the base from the previous frame to
    this one. A point is P_previous = R(yaw) P_now + t; all is divided by its depth now, so that infinity is a value
    like others. Derivatives: by x, y, yaw, roll, pitch.
    """
    x_m, y_m, yaw = (value[:, None] for value in motion.split(1, dim=1))  # each (B, 1, 1)
    cos, sin = torch.cos(yaw), torch.sin(yaw)
    ray = torch.matmul(cells.rotation, torch.cat([cells.here, torch.ones_like(inverse_depth)], dim=1))
    point = ray + inverse_depth * cells.lens
    turned_x = cos * point[:, :1] - sin * point[:, 1:2]
    turned_y = sin * point[:, :1] + cos * point[:, 1:2]
    shift_x, shift_y, shift_z = (inverse_depth * value for value in cells.lens.split(1, dim=1))
    before_x = turned_x + inverse_depth * x_m - shift_x
    before_y = turned_y + inverse_depth * y_m - shift_y
    before_z = point[:, 2:] - shift_z
    nothing = torch.zeros_like(before_x)
    columns = [
        (before_x, before_y, before_z),
        (inverse_depth, nothing, nothing),
        (nothing, inverse_depth, nothing),
        (-turned_y, turned_x, nothing),
        (nothing, -before_z, before_y),
        (before_z, nothing, -before_x),
    ]
    base = torch.stack([torch.cat(column, dim=1) for column in columns], dim=1)  # (B, 6, 3, N)
    optical = torch.matmul(cells.rotation.transpose(1, 2)[:, None], base)
    here, moved = optical[:, 0], optical[:, 1:]
    depth = here[:, 2:].clamp_min(LEAST_DEPTH)
    bearing = here[:, :2] / depth
    slopes = (moved[:, :, :2] - bearing[:, None] * moved[:, :, 2:]) / depth[:, None]
    return bearing, slopes.transpose(1, 2)


@dataclass(frozen=True, slots=True)
class Solution:
    """motion: (B, 3). information: its inverse covariance, (B, 3, 3). covariance: (B, 3, 3)."""

    motion: Tensor
    information: Tensor
    covariance: Tensor


def solve(
    slopes: Tensor, residuals: Tensor, weights: Tensor, start: Tensor, prior: Tensor, prior_information: Tensor
) -> Solution:
    """The motion that explains the residuals best; tilt is solved for beside it and marginalised.

    slopes: (B, 2, 5, N). residuals: measured less predicted bearings at `start`, (B, 2, N). weights: information of
    each, (B, 2, N). prior: another estimate of the motion, (B, 3), with independent information (B, 3). One step of
    Gauss and Newton from `start`, (B, 3), normal equations solved by blocks (Schur complement).
    """
    # In float64: what the tilt takes off the motion's information is nearly all of it where only far things are seen.
    rows = slopes.transpose(1, 2).flatten(2).double()  # (B, 5, 2N)
    weighted = rows * weights.flatten(1)[:, None].double()
    prior_information = prior_information.double()
    normal = torch.matmul(weighted, rows.transpose(1, 2))
    right = torch.matmul(weighted, residuals.flatten(1)[:, :, None].double())
    motion, cross, tilt = normal[:, :3, :3], normal[:, :3, 3:], normal[:, 3:, 3:]
    eye3 = torch.eye(3, dtype=normal.dtype)
    motion = motion + eye3 * prior_information[:, :, None]
    tilt = tilt + torch.eye(2, dtype=normal.dtype) / TILT_SIGMA_RAD**2
    pull = right[:, :3] + (prior_information * (prior - start).double())[:, :, None]
    through = torch.matmul(cross, inverse2(tilt))
    information = motion - torch.matmul(through, cross.transpose(1, 2))
    pull = pull - torch.matmul(through, right[:, 3:])
    covariance = inverse3(information)
    step, kind = torch.matmul(covariance, pull)[:, :, 0], start.dtype
    return Solution(start + step.to(kind), information.to(kind), covariance.to(kind))


def inverse2(matrix: Tensor) -> Tensor:
    """Of symmetric (B, 2, 2)."""
    a, b, d = matrix[:, :1, :1], matrix[:, :1, 1:], matrix[:, 1:, 1:]
    determinant = a * d - b * b
    return torch.cat([torch.cat([d, -b], dim=2), torch.cat([-b, a], dim=2)], dim=1) / determinant


def inverse3(matrix: Tensor) -> Tensor:
    """Of symmetric positive (B, 3, 3), by cofactors, after scaling its diagonal to 1."""
    root = torch.stack([matrix[:, i, i] for i in range(3)], dim=1).rsqrt()
    scaled = matrix * root[:, :, None] * root[:, None]
    a, b, c = scaled[:, 0, 1], scaled[:, 0, 2], scaled[:, 1, 2]
    ab, ac, bc = b * c - a, a * c - b, a * b - c
    rows = [torch.stack(row, dim=1) for row in ((1.0 - c * c, ab, ac), (ab, 1.0 - b * b, bc), (ac, bc, 1.0 - a * a))]
    determinant = (1.0 - c * c) + a * ab + b * ac
    adjugate = torch.stack(rows, dim=1)
    return adjugate / determinant.clamp_min(1e-9)[:, None, None] * root[:, :, None] * root[:, None]
