"""The flow odometry head: the displacement of every cell since the previous picture, and the motion that explains it.

Correlation of the backbone's early features with the previous ones, first coarse over a wide range, then fine around
the coarse motion's prediction; a ConvLSTM carries the memory. The motion follows from the cells' displacements by least
squares with the geometry of lens, mount and floor (`rigid`), so that one head fits any of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from edgemap.export.errors import ExportError
from edgemap.export.odometry.correlation import (
    SLOPE,
    FilledConv,
    correlate,
    expected_displacement,
    offsets,
    two_convs,
    unit_vectors,
    warped_back,
)
from edgemap.export.odometry.rigid import CellGeometry, MotionSolution, ShownCells, solve

GRID_STRIDE = 16  # px of the input per cell of the displacements
COARSE_ROWS, COARSE_COLUMNS = 3, 7  # reach of the coarse search, in cells of stride 16: 112 px to the sides
SIGMA = 0.01  # a cell's weight of 1 stands for this standard deviation of its bearing
FAR_INVERSE_DEPTH = 0.4  # 1/unit, what is taken for the depth of a cell that does not see the floor, at first
FASTEST = (3.0, 1.0, 0.8)  # units, units, rad of one step: the coarse motion is cut to it, so that no outlier runs away


@dataclass(frozen=True)
class FlowSizes:
    """Numbers of channels in a flow head; the defaults make one of 0.4 million parameters.

    fine, coarse: of a cell's descriptor at stride 8 and 16. width: of both searches. narrow: of the correlation scores
    that the fine search reads. hidden: of the memory. reach: of the fine search around the prediction, in cells of
    stride 8.
    """

    fine: int = 32
    coarse: int = 48
    width: int = 64
    narrow: int = 48
    hidden: int = 32
    reach: int = 3


SMALL = FlowSizes(16, 32, 32, 28, 16, 2)  # of one that `smaller` makes: half the time


@dataclass(frozen=True, slots=True)
class Search:
    """Result of one search. moved: displacements, in cells, to the previous positions, (B, 2, H, W). inverse_depth:
    (B, 1, H, W), 1/unit. solution: the motion from it, in units."""

    moved: Tensor
    inverse_depth: Tensor
    solution: MotionSolution


class FlowHead(nn.Module):
    """Features of one frame, the geometry and the state to the base's motion, its covariance and the new state.

    shape: (1, C, H, W) of the features, stride: theirs, 4 or 8 input px. unit_m: the head's unit of length, metres, so
    that depths and speeds learnt on indoor robots transfer to a car's scale (`start.unit_of`). Buffers, not trained by
    gradient: feature_mean and feature_std, (1, C, 1, 1). Raises ExportError for features that do not fit.
    """

    def __init__(self, shape: Sequence[int], stride: int, sizes: FlowSizes | None = None, unit_m: float = 1.0) -> None:
        super().__init__()
        sizes = sizes or FlowSizes()
        _, channels, height, width = shape
        if stride not in (4, 8) or (height * stride) % GRID_STRIDE or (width * stride) % GRID_STRIDE:
            raise ExportError(f"flow head: features {tuple(shape)} of stride {stride}; 4 or 8 are wanted")
        self.shape, self.stride, self.sizes = (1, channels, height, width), stride, sizes
        self.unit_m = unit_m
        self.rows, self.columns = height * stride // GRID_STRIDE, width * stride // GRID_STRIDE
        self.reduce = nn.Conv2d(channels, sizes.fine, 3, 8 // stride, 1)
        self.coarsen = nn.Conv2d(sizes.fine, sizes.coarse, 3, 2, 1)
        coarse_window = (2 * COARSE_ROWS + 1) * (2 * COARSE_COLUMNS + 1)
        fine_window = (2 * sizes.reach + 1) ** 2
        self.sharpness = nn.Parameter(torch.tensor([8.0, 8.0]))
        self.search = two_convs(coarse_window + sizes.coarse + sizes.hidden + 7, sizes.width)
        self.tell = nn.Conv2d(sizes.width, 5, 3, padding=1)
        self.narrow = FilledConv(fine_window + sizes.fine, sizes.narrow, 3, 2, 1)
        self.refine = two_convs(sizes.narrow + sizes.width + 4, sizes.width)
        self.retell = nn.Conv2d(sizes.width, 5, 3, padding=1)
        self.remember = nn.Conv2d(sizes.width, sizes.hidden, 3, 2, 1)
        self.gates = nn.Conv2d(2 * sizes.hidden, 4 * sizes.hidden, 3, padding=1)
        self.expect = nn.Linear(sizes.hidden, 6)
        self.evidence = nn.Parameter(torch.tensor([-3.0, -3.0]))  # log of one more cell's weight: errors correlate
        for layer in (self.tell, self.retell, self.expect):
            nn.init.normal_(layer.weight, std=1e-3)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        with torch.no_grad():
            self.gates.bias[sizes.hidden : 2 * sizes.hidden] = 1.0  # type: ignore[index]
        self.feature_mean: Tensor
        self.feature_std: Tensor
        self.register_buffer("feature_mean", torch.zeros(1, channels, 1, 1))
        self.register_buffer("feature_std", torch.ones(1, channels, 1, 1))
        self.fastest: Tensor
        self.register_buffer("fastest", torch.tensor([FASTEST]), persistent=False)
        self.coarse_offsets: Tensor
        self.fine_offsets: Tensor
        self.register_buffer("coarse_offsets", offsets(COARSE_ROWS, COARSE_COLUMNS), persistent=False)
        self.register_buffer("fine_offsets", offsets(sizes.reach, sizes.reach), persistent=False)

    @property
    def parameters_count(self) -> int:
        """Trainable parameters."""
        return sum(parameter.numel() for parameter in self.parameters())

    @property
    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the state: previous features, fine and coarse; the ConvLSTM's; the last velocity
        in units."""
        rows, columns = self.rows, self.columns
        memory = (1, self.sizes.hidden, (rows + 1) // 2, (columns + 1) // 2)
        return {
            "fine": (1, self.sizes.fine, 2 * rows, 2 * columns),
            "coarse": (1, self.sizes.coarse, rows, columns),
            "hidden": memory,
            "cell": memory,
            "velocity": (1, 3),
        }

    def describe(self, feature: Tensor) -> tuple[Tensor, Tensor]:
        """Raw features to unit vectors per cell, of stride 8 and 16."""
        fine = self.describe_fine(feature)
        coarse = self.coarsen(functional.leaky_relu(fine, SLOPE))
        return unit_vectors(fine), unit_vectors(coarse)

    def describe_fine(self, feature: Tensor) -> Tensor:
        """The fine descriptors before normalisation to unit length: (feature - mean) / std, convolved. Mean and
        deviation are folded into weights and offset, which saves a pass over the feature map.
        """
        weight, stride = self.reduce.weight / self.feature_std, self.reduce.stride
        mean = functional.conv2d(self.feature_mean.expand(self.shape), weight, None, stride, 1)
        return functional.conv2d(feature, weight, self.reduce.bias, stride, 1) - mean

    def forward(
        self, feature: Tensor, cells: Tensor, mount: Tensor, dt_s: Tensor, *state: Tensor
    ) -> tuple[Tensor, ...]:
        """One step. feature (1, C, H, W); cells (1, 8, rows, columns) and mount (1, 12) as `flow_cells` gives them.

        dt_s: (1, 1), seconds since the previous frame. Gives motion (1, 3) forward_m, left_m, yaw_rad of the base,
        its covariance (1, 3, 3), then the new state.
        """
        fine, coarse = self.describe(feature)
        geometry = CellGeometry.of(cells, mount, self.unit_m)
        last, hidden, cell = self.match(fine, coarse, geometry, dt_s, *state)[1:]
        motion = last.solution.motion
        return *self.metric(last.solution), fine, coarse, hidden, cell, motion / dt_s

    def metric(self, solution: MotionSolution) -> tuple[Tensor, Tensor]:
        """The motion (B, 3) and its covariance (B, 3, 3) in metres and radians."""
        if self.unit_m == 1.0:
            return solution.motion, solution.covariance
        units = self.units(solution.motion)
        return solution.motion * units, solution.covariance * (units[:, None] * units)

    def units(self, like: Tensor) -> Tensor:
        """Units of the motion, (3,): metres, metres, radians for a value of 1."""
        return functional.pad(like.new_full((2,), self.unit_m), (0, 1), value=1.0)

    def match(
        self,
        fine: Tensor,
        coarse: Tensor,
        geometry: CellGeometry,
        dt_s: Tensor,
        fine_before: Tensor,
        coarse_before: Tensor,
        hidden: Tensor,
        cell: Tensor,
        velocity: Tensor,
    ) -> tuple[Search, Search, Tensor, Tensor]:
        """Both searches, (B, ...): the coarse and the fine one, and the new memory."""
        expected = self.expect(hidden.mean(dim=(2, 3)))
        prior = velocity * dt_s * (1.0 + 0.1 * torch.tanh(expected[:, :3]))
        prior_information = torch.exp(expected[:, 3:].clamp(-4.0, 4.0)) / (dt_s * dt_s) * 50.0
        floor = torch.where(geometry.floor > 0.0, geometry.floor, FAR_INVERSE_DEPTH * torch.ones_like(geometry.floor))
        shape = (self.rows, self.columns)
        known = torch.cat([geometry.here, geometry.floor, geometry.shown, floor.log() * 0.3], dim=1).unflatten(2, shape)

        scores = correlate(coarse, coarse_before, COARSE_ROWS, COARSE_COLUMNS)
        guess = expected_displacement(scores, self.coarse_offsets, self.sharpness[0])
        memory = functional.interpolate(hidden, size=(self.rows, self.columns), mode="nearest")
        found = self.search(torch.cat([scores.permute(0, 3, 1, 2), coarse, memory, known, guess * 0.3], dim=1))
        sight = ShownCells.of(geometry, prior)
        first = self._read(self.tell(found), guess, floor, geometry, sight, prior, prior, prior_information, 0)

        found_first = first.solution.motion
        bounded = torch.maximum(torch.minimum(found_first, self.fastest), -self.fastest)
        start = found_first + (bounded - found_first).detach()  # so that the gradient still says which way is back
        sight = ShownCells.of(geometry, start)
        predicted = geometry.cells_of(sight.bearings(first.inverse_depth.flatten(2)) - geometry.here).unflatten(
            2, shape
        )
        scores = correlate(fine, warped_back(fine_before, predicted), self.sizes.reach, self.sizes.reach)
        nearer = functional.avg_pool2d(expected_displacement(scores, self.fine_offsets, self.sharpness[1]), 2) * 0.5
        finer = functional.leaky_relu(self.narrow(torch.cat([scores.permute(0, 3, 1, 2), fine], dim=1)), SLOPE)
        found = self.refine(torch.cat([finer, found, nearer, first.moved - predicted], dim=1))
        second = self._read(
            self.retell(found), predicted + nearer, first.inverse_depth.flatten(2), geometry, sight, start, prior,
            prior_information, 1,
        )  # fmt: skip
        hidden, cell = self._recall(self.remember(found), hidden, cell)
        return first, second, hidden, cell

    def _read(
        self, outputs: Tensor, guess: Tensor, inverse_depth: Tensor, geometry: CellGeometry, sight: ShownCells,
        start: Tensor, prior: Tensor, prior_information: Tensor, stage: int,
    ) -> Search:  # fmt: skip
        """The network's outputs of each cell, and the motion that explains them best."""
        outputs = outputs.float()
        moved = guess + outputs[:, :2] * 4.0
        weights = torch.exp((outputs[:, 2:4] * 4.0).clamp(-6.0, 6.0)) * geometry.shown.unflatten(2, outputs.shape[2:])
        information = weights / SIGMA**2
        # The floor's depth is known but for the tilt; anything may stand before it or hang above it.
        depth = inverse_depth * torch.exp((outputs[:, 4:].flatten(2) * 4.0).clamp(-2.5, 2.5))
        bearings, slopes = sight.slopes(depth)
        measured = geometry.here + geometry.bearings_of(moved.flatten(2))
        used = information.flatten(2) * torch.exp(self.evidence[stage])
        solution = solve(slopes, measured - bearings, used, start, prior, prior_information)
        return Search(moved, depth.unflatten(2, outputs.shape[2:]), solution)

    def _recall(self, x: Tensor, hidden: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """One ConvLSTM step (Shi et al. 2015)."""
        i, f, o, g = torch.split(self.gates(torch.cat([x, hidden], dim=1)), self.sizes.hidden, dim=1)
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
        return torch.sigmoid(o) * torch.tanh(cell), cell
