"""Displacement of picture points by a motion of the base, and the least-squares motion from displacements.

Everything is in normalised image points ("bearings") of cells on a grid, so that one network serves any lens and mount.
Batches: B pictures, N cells. The unknowns are the base's motion since the previous frame (x, y, yaw rad; lengths in the
head's unit) and how much the camera tilted on its springs meanwhile (roll, pitch, rad).
"""

from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

MINIMUM_DEPTH = 0.05  # of a point before the previous camera, relative to its depth now
TILT_SIGMA_RAD = 0.006  # of the camera on its mount from one frame to the next


def placed(constant: Tensor, like: Tensor, kind: torch.dtype | None = None) -> Tensor:
    """A constant where `like` is and of its kind, or of another one. A GPU gets it once: it would wait for a copy."""
    if like.device.type == "cpu":
        return constant.to(like.device, kind or like.dtype)
    return _copied(constant, like.device, kind or like.dtype)


@cache
def _copied(constant: Tensor, device: torch.device, kind: torch.dtype) -> Tensor:
    return constant.to(device, kind)


@dataclass(frozen=True, slots=True)
class CellGeometry:
    """Constant geometry, as `geometry.flow_cells` gives it, flattened, lengths in a head's unit. here: bearings
    (B, 2, N). right, down: change of the bearing per cell, (B, 2, N). floor: inverse depth of the floor, (B, 1, N).
    shown: 0 or 1, (B, 1, N). rotation: base from optical, (B, 3, 3). lens: in the base frame, (B, 3, 1)."""

    here: Tensor
    right: Tensor
    down: Tensor
    floor: Tensor
    shown: Tensor
    rotation: Tensor
    lens: Tensor

    @staticmethod
    def of(cells: Tensor, mount: Tensor, unit_m: float = 1.0) -> "CellGeometry":
        """cells: (B, 8, H, W). mount: (B, 12). unit_m: the unit of length, metres."""
        flat = cells.flatten(2)
        here, right, down, floor, shown = flat.split([2, 2, 2, 1, 1], dim=1)
        rotation, lens = mount[:, :9].reshape(-1, 3, 3), mount[:, 9:].reshape(-1, 3, 1)
        if unit_m != 1.0:
            floor, lens = floor * unit_m, lens / unit_m
        return CellGeometry(here, right, down, floor, shown, rotation, lens)

    def bearings_of(self, cells_moved: Tensor) -> Tensor:
        """Displacements in cells (right, down), (B, 2, N), as displacements of the bearing, to first order."""
        return self.right * cells_moved[:, :1] + self.down * cells_moved[:, 1:]

    def cells_of(self, bearings: Tensor) -> Tensor:
        """Displacements of the bearing as displacements in cells, (B, 2, N); 0 where nothing is shown."""
        determinant = self.right[:, :1] * self.down[:, 1:] - self.right[:, 1:] * self.down[:, :1]
        across = torch.cat([self.down[:, 1:], -self.right[:, 1:]], dim=1) * bearings[:, :1]
        along = torch.cat([-self.down[:, :1], self.right[:, :1]], dim=1) * bearings[:, 1:]
        return (across + along) * (self.shown / (determinant + (1.0 - self.shown)))


@dataclass(frozen=True, slots=True)
class ShownCells:
    """Projection of the current cells into the previous picture, for one motion of the base. It is linear in rays and
    inverse depths, with one small matrix. The start-up of operators dominates the cost of a head's step, so there are
    few large ones. rays: (B, 3, N), optical. by: (B, 18, 4): x, y and z of the point and of its change by x, y, yaw,
    roll and pitch, all divided by the depth now; by ray and inverse depth.
    """

    rays: Tensor
    by: Tensor

    @staticmethod
    def of(cells: CellGeometry, motion: Tensor) -> "ShownCells":
        """motion: (B, 3), of the base from the previous frame to this one: P_previous = R(yaw) P_now + t."""
        yaw = motion[:, 2:]
        turned = torch.cat([torch.cos(yaw), torch.sin(yaw)], dim=1)
        lens = cells.lens[:, :2, 0]
        lens_turned = turned[:, :1] * lens + turned[:, 1:] * (lens @ placed(_QUARTER_TURN, lens))
        before = lens_turned + motion[:, :2] - lens
        known = torch.cat([turned, lens_turned, before, torch.ones_like(yaw)], dim=1)
        base = torch.matmul(known, placed(_POINT_AND_CHANGES, known)).reshape(-1, 3, 24)  # rows x, y, z of the base
        optical = torch.matmul(cells.rotation.transpose(1, 2), base).reshape(-1, 18, 4)
        by = torch.cat([torch.matmul(optical[:, :, :3], cells.rotation), optical[:, :, 3:]], dim=2)
        rays = torch.cat([cells.here, torch.ones_like(cells.floor)], dim=1)
        return ShownCells(rays, by)

    def bearings(self, inverse_depth: Tensor) -> Tensor:
        """Bearings in the previous picture (B, 2, N). inverse_depth: along the optical axis now, 1/m, (B, 1, N)."""
        seen = torch.matmul(self.by[:, ::6], torch.cat([self.rays, inverse_depth], dim=1))
        return seen[:, :2] / seen[:, 2:].clamp_min(MINIMUM_DEPTH)

    def slopes(self, inverse_depth: Tensor) -> tuple[Tensor, Tensor]:
        """The bearings (B, 2, N), and their derivatives (B, 2, 5, N): by x, y, yaw, roll, pitch."""
        seen = torch.matmul(self.by, torch.cat([self.rays, inverse_depth], dim=1)).unflatten(1, (3, 6))
        flat, away = seen[:, :2], seen[:, 2:]
        depth = away[:, :, :1].clamp_min(MINIMUM_DEPTH)
        bearing = flat[:, :, :1] / depth
        return bearing[:, :, 0], (flat[:, :, 1:] - bearing * away[:, :, 1:]) / depth


def _point_and_changes() -> Tensor:
    """(7, 72): from cos, sin, turned lens x, y, its place x, y and 1 to the point and its changes in the base frame,
    (3, 6, 4) of x, y, z; by x, y and z of the ray, and by inverse depth."""
    cos, sin, lens_x, lens_y, at_x, at_y, one = range(7)
    table = torch.zeros(7, 3, 6, 4)
    x, y, z = (table[:, axis, 0] for axis in range(3))
    x[cos, 0], x[sin, 1], x[at_x, 3] = 1.0, -1.0, 1.0
    y[sin, 0], y[cos, 1], y[at_y, 3] = 1.0, 1.0, 1.0
    z[one, 2] = 1.0  # the lens stays at its height
    table[one, 0, 1, 3] = table[one, 1, 2, 3] = 1.0
    table[sin, 0, 3, 0], table[cos, 0, 3, 1], table[lens_y, 0, 3, 3] = -1.0, -1.0, -1.0
    table[cos, 1, 3, 0], table[sin, 1, 3, 1], table[lens_x, 1, 3, 3] = 1.0, -1.0, 1.0
    table[:, 1, 4], table[:, 2, 4] = -z, y
    table[:, 0, 5], table[:, 2, 5] = z, -x
    return table.reshape(7, 72)


_POINT_AND_CHANGES = _point_and_changes()
_QUARTER_TURN = torch.tensor([[0.0, 1.0], [-1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class MotionSolution:
    """motion: (B, 3). information: its inverse covariance, (B, 3, 3). covariance: (B, 3, 3)."""

    motion: Tensor
    information: Tensor
    covariance: Tensor


def solve(
    slopes: Tensor, residuals: Tensor, weights: Tensor, start: Tensor, prior: Tensor, prior_information: Tensor
) -> MotionSolution:
    """The motion that explains the residuals best; tilt is solved for beside it and marginalised.

    slopes: (B, 2, 5, N). residuals: measured less predicted bearings at `start`, (B, 2, N). weights: information of
    each, (B, 2, N). prior: another estimate of the motion, (B, 3), with independent information (B, 3). One step of
    Gauss and Newton from `start`, (B, 3); the normal equations with their right side are one symmetric (B, 6, 6).
    """
    # In float64: where only far points are visible, marginalising the tilt leaves little of the motion's information.
    rows = torch.cat([slopes, residuals[:, :, None]], dim=2).double()
    normal = torch.matmul(rows * weights[:, :, None].double(), rows.transpose(2, 3)).sum(dim=1)
    offset = torch.cat([prior - start, torch.zeros_like(start)], dim=1)[:, :, None]  # of the tilts' priors: none
    weight = torch.cat([prior_information, torch.full_like(start, TILT_SIGMA_RAD**-2)], dim=1)[:, :, None]
    eye = torch.eye(6, dtype=normal.dtype, device=normal.device)
    known = torch.cat([eye[:5, :5].expand(len(start), 5, 5), offset[:, :5].double()], dim=2)  # the priors, as rows
    normal = normal[:, :5] + weight[:, :5].double() * known
    normal = _without(_without(normal, 4), 3)
    information, pull = normal[:, :, :3], normal[:, :, 5:]
    covariance = inverse3(information)
    step, kind = torch.matmul(covariance, pull)[:, :, 0], start.dtype
    return MotionSolution(start + step.to(kind), information.to(kind), covariance.to(kind))


def _without(normal: Tensor, unknown: int) -> Tensor:
    """Normal equations (B, unknown + 1, 6) with their last row's unknown solved for and put in: one row fewer."""
    last = normal[:, unknown:]
    return normal[:, :unknown] - normal[:, :unknown, unknown : unknown + 1] * (last / last[:, :, unknown : unknown + 1])


def inverse3(matrix: Tensor) -> Tensor:
    """Inverses of symmetric positive definite matrices (B, 3, 3) in float64, by cofactors."""
    flat = matrix.flatten(1)
    first, second, third, fourth = (flat.index_select(1, placed(places, flat, torch.long)) for places in _COFACTORS)
    adjugate = first * second - third * fourth
    determinant = torch.matmul(flat[:, None, :3], adjugate[:, :3, None])[:, 0].clamp_min(1e-9)
    return (adjugate / determinant).unflatten(1, (3, 3))


_COFACTORS = torch.tensor(
    (
        (4, 5, 3, 7, 8, 6, 1, 2, 0),
        (8, 6, 7, 2, 0, 1, 5, 3, 4),
        (5, 3, 4, 8, 6, 7, 2, 0, 1),
        (7, 8, 6, 1, 2, 0, 4, 5, 3),
    )
).unbind()
