"""The flow head's loss: the motion, from both searches, with a consistent covariance."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from edgemap.export.odometry.flow import FlowHead, Search
from edgemap.export.odometry.rigid import CellGeometry, MotionSolution, placed

MOTION_SIGMA = torch.tensor([0.006, 0.004, 0.006])
WARM_UP = 0.15  # of the training in which the covariance is not yet taught (Huber loss instead)
COVARIANCE_WEIGHT = 0.03
OUTLIER = 9.0  # squared normalised error beyond which an error counts linearly
COARSE_WEIGHT = 0.3  # of the coarse search's motion against the fine one's


@dataclass(frozen=True, slots=True)
class ClipBatch:
    """Clips of equal length T. features: (B, T, C, H, W). cells: (B, T, 8, h, w), mount (B, T, 12): of each frame.
    dt_s: (B, T), of each frame since the one before; of the first it does not count. motions: (B, T, 3), likewise."""

    features: Tensor
    cells: Tensor
    mount: Tensor
    dt_s: Tensor
    motions: Tensor


def run_clip(
    head: FlowHead, batch: ClipBatch, state: list[Tensor] | None = None
) -> tuple[list[tuple[Search, Search]], list[Tensor]]:
    """Both searches of frames 1 to T - 1, lengths in the head's unit, and the state after them: memory and velocity.

    state: before frame 1; None is a fresh one. Frame 0 only gives its features.
    """
    clips, length = batch.features.shape[:2]
    fine, coarse = (part.unflatten(0, (clips, length)) for part in head.describe(batch.features.flatten(0, 1)))
    fresh = [
        fine.new_zeros(clips, *head.state_shapes[name][1:], dtype=torch.float32)
        for name in ("hidden", "cell", "velocity")
    ]
    hidden, cell, velocity = state or fresh
    searches = []
    for index in range(1, length):
        dt_s = batch.dt_s[:, index : index + 1]
        geometry = CellGeometry.of(batch.cells[:, index], batch.mount[:, index], head.unit_m)
        first, second, hidden, cell = head.match(
            fine[:, index], coarse[:, index], geometry, dt_s, fine[:, index - 1], coarse[:, index - 1],
            hidden, cell, velocity,
        )  # fmt: skip
        velocity = second.solution.motion.detach() / dt_s
        searches.append((first, second))
    return searches, [hidden, cell, velocity]


def flow_loss(
    head: FlowHead, batch: ClipBatch, progress: float, sigma: Tensor = MOTION_SIGMA
) -> tuple[Tensor, dict[str, Tensor]]:
    """The loss of a batch of clips, and its parts for the curves. progress: share of the training done, 0..1. sigma:
    (3,), units, units, rad: what counts as a small error of one step."""
    motion, coarse = [], []
    units = head.units(batch.motions)
    for index, (first, second) in enumerate(run_clip(head, batch)[0], start=1):
        true = batch.motions[:, index] / units
        motion.append(_motion_loss(second.solution, true, progress, sigma))
        coarse.append(_huber((first.solution.motion - true) / placed(sigma, true) / 2.0).mean())
    parts = {"motion": torch.stack(motion).mean(), "coarse": torch.stack(coarse).mean()}
    total = parts["motion"] + COARSE_WEIGHT * parts["coarse"]
    return total, {name: value.detach() for name, value in parts.items()}


def _motion_loss(solution: MotionSolution, true: Tensor, progress: float, sigma: Tensor) -> Tensor:
    """Huber's loss of the motion, and the likelihood of its error under the covariance.

    The likelihood teaches the covariance alone, not the motion: minimised for both, a network that errs a lot at first
    learns to doubt and nothing else.
    """
    error = solution.motion - true
    plain = _huber(error / placed(sigma, true)).mean()
    if progress < WARM_UP:
        return plain
    error = error.detach()
    normalised = torch.einsum("bi,bij,bj->b", error, solution.information, error)
    surprise = 0.5 * (_beyond(normalised) - _logdet3(solution.information))
    return plain + COVARIANCE_WEIGHT * surprise.mean()


def _logdet3(matrix: Tensor) -> Tensor:
    """Of symmetric positive (B, 3, 3), scaled to a diagonal of 1 first; bounded where rounding made it singular."""
    diagonal = torch.diagonal(matrix, dim1=1, dim2=2)
    root = diagonal.rsqrt()
    scaled = matrix * root[:, :, None] * root[:, None]
    a, b, c = scaled[:, 0, 1], scaled[:, 0, 2], scaled[:, 1, 2]
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    return diagonal.log().sum(dim=1) + determinant.clamp_min(1e-6).log()


def _beyond(squared: Tensor) -> Tensor:
    """Huber's on a squared error: linear in the error beyond `OUTLIER`."""
    return torch.where(squared < OUTLIER, squared, 2.0 * (OUTLIER * squared.clamp_min(OUTLIER)).sqrt() - OUTLIER)


def _huber(error: Tensor) -> Tensor:
    return functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
