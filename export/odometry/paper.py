"""The paper's odometry head: stacked ConvLSTM (Shi et al. 2015) on a coarse feature map, state explicit."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from edgemap.export.errors import ExportError
from edgemap.export.torch_files import parameter_count

PARAMETER_LIMIT = 2_509_555  # the paper's count of trainable parameters, section 4.3
HIDDEN = (64, 64)  # channels of both layers
WIDEST_DENSE, NARROWEST_DENSE = 128, 16
LARGE = 1000  # values of a tensor that is kept in 8 bits
SLOPE = 0.1  # of the leaky ReLU, as in Darknet


class ConvLSTMCell(nn.Module):
    """One ConvLSTM step; hidden h and cell c go in and come out, (1, hidden, H, W).

    i, f, o = sigmoid and g = leaky ReLU of one convolution over [x, h]; c' = f c + i g; h' = o leaky ReLU(c'). The
    leaky ReLU stands where the textbook has tanh, kernels are 3x3 (section 4.5). The forget gate's bias starts at 1.
    """

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.hidden = hidden
        self.gates = nn.Conv2d(channels + hidden, 4 * hidden, 3, padding=1)

    def forward(self, x: Tensor, h: Tensor, c: Tensor) -> tuple[Tensor, Tensor]:
        """The new state (h, c) from x (1, channels, H, W) and the state before."""
        i, f, o, g = torch.split(self.gates(torch.cat([x, h], dim=1)), self.hidden, dim=1)
        c = torch.sigmoid(f) * c + torch.sigmoid(i) * functional.leaky_relu(g, SLOPE)
        return torch.sigmoid(o) * functional.leaky_relu(c, SLOPE), c


class PaperHead(nn.Module):
    """Features of one frame and the state to the base's motion since the previous frame, and the new state.

    Two ConvLSTM layers of 64 channels on the standardised map, then two dense layers over ALL cells. Pooling over cells
    would be cheaper, but it discards the position of a motion in the picture, which distinguishes rotation from
    translation. The first dense layer is as wide (up to 128) as the paper's parameter count allows.

    shape: (1, C, H, W) of the features. Buffers, not trained by gradient: feature_mean and feature_std, (1, C, 1, 1);
    motion_scale (3,), metres, metres, radians per unit of output. Raises ExportError where the count is exceeded.
    """

    def __init__(self, shape: Sequence[int], hidden: Sequence[int] = HIDDEN, dense: int | None = None) -> None:
        super().__init__()
        _, channels, height, width = shape
        self.shape, self.hidden = (1, channels, height, width), tuple(hidden)
        inputs = [channels, *hidden[:-1]]
        self.cells = nn.ModuleList(ConvLSTMCell(i, o) for i, o in zip(inputs, hidden, strict=True))
        flat = hidden[-1] * height * width
        self.dense = nn.Linear(flat, dense or _dense_units(flat, parameter_count(self.cells), self.shape))
        self.out = nn.Linear(self.dense.out_features, 3)
        self.feature_mean: Tensor
        self.feature_std: Tensor
        self.motion_scale: Tensor
        self.register_buffer("feature_mean", torch.zeros(1, channels, 1, 1))
        self.register_buffer("feature_std", torch.ones(1, channels, 1, 1))
        self.register_buffer("motion_scale", torch.tensor([0.02, 0.01, 0.04]))

    @property
    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of hidden1, cell1, hidden2, cell2, …, each (1, hidden, H, W)."""
        return {
            f"{word}{layer}": (1, hidden, *self.shape[2:])
            for layer, hidden in enumerate(self.hidden, start=1)
            for word in ("hidden", "cell")
        }

    def forward(self, feature: Tensor, *state: Tensor) -> tuple[Tensor, ...]:
        """feature (1, C, H, W), state h1, c1, h2, c2: motion (1, 3) forward_m, left_m, yaw_rad, then the new state."""
        x = (feature - self.feature_mean) / self.feature_std
        new: list[Tensor] = []
        for cell, h, c in zip(self.cells, state[0::2], state[1::2], strict=True):
            x, c = cell(x, h, c)
            new += [x, c]
        x = functional.leaky_relu(self.dense(x.flatten(1)), SLOPE)
        return self.out(x) * self.motion_scale, *new


def random_head(shape: Sequence[int], seed: int = 0) -> PaperHead:
    """An untrained head whose weights follow from the seed alone."""
    head = PaperHead(shape)
    generator = torch.Generator().manual_seed(seed)
    for name, tensor in head.state_dict().items():  # which shares the head's memory
        if name.endswith(".weight"):
            bound = tensor[0].numel() ** -0.5
            tensor.uniform_(-bound, bound, generator=generator)
        elif name.endswith(".bias"):
            tensor.zero_()
        if name.endswith(".gates.bias"):
            tensor.chunk(4)[1].fill_(1.0)  # the forget gate's
    return head


def eight_bits(weight: Tensor) -> tuple[Tensor, Tensor]:
    """Whole numbers from -127 to 127 and a scale for each output, (N, 1, …): their product is nearly the weight."""
    scale = weight.abs().amax(dim=tuple(range(1, weight.ndim)), keepdim=True).clamp_min(1e-12) / 127.0
    return (weight / scale).round(), scale


def _dense_units(flat: int, used: int, shape: tuple[int, ...]) -> int:
    room = (PARAMETER_LIMIT - used - 3) // (flat + 4)
    units = min(WIDEST_DENSE, room // 16 * 16)
    if units < NARROWEST_DENSE:
        raise ExportError(
            f"paper head on features {shape}: {used + NARROWEST_DENSE * (flat + 4) + 3:,} parameters, "
            f"the paper allows {PARAMETER_LIMIT:,}"
        )
    return units
