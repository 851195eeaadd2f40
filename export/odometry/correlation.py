"""What the flow head searches with: correlation of two feature maps, displacements from it, and layers.

Correlation: how alike each cell is to the cells around it in the previous picture.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

BLOCK = 13  # columns that are compared with one window of the previous picture, or as near as a divisor comes
SLOPE = 0.1  # of the leaky ReLU


def correlate(now: Tensor, before: Tensor, rows: int, columns: int) -> Tensor:
    """Dot products over a window of +-rows, +-columns: (B, C, H, W) twice to (B, H, W, (2 rows + 1)(2 columns + 1)).

    One matrix product for every block of columns and all row shifts, whose diagonals are read off by padding and
    reshaping: slices and products one by one take five times as long in onnxruntime. The window runs over rows first,
    then columns.
    """
    batch, channels, height, width = now.shape
    block = min((d for d in range(1, width + 1) if width % d == 0), key=lambda d: abs(d - BLOCK))
    shifts, window = 2 * rows + 1, block + 2 * columns
    queries = now.permute(0, 2, 3, 1).reshape(batch, height, width // block, block, channels)
    padded = functional.pad(before.permute(0, 2, 3, 1), (0, 0, columns, columns, rows, rows))[:, :, None]
    keys = torch.cat([padded[:, :, :, first : first + window] for first in range(0, width, block)], dim=2)
    keys = torch.cat([keys[:, shift : shift + height] for shift in range(shifts)], dim=3)
    products = torch.matmul(queries, keys.transpose(3, 4))  # (B, H, blocks, block, shifts * window)
    span = shifts * window
    skewed = functional.pad(products.flatten(3), (0, block)).unflatten(3, (block, span + 1))[..., :span]
    return skewed.reshape(batch, height, width, shifts, window)[..., : 2 * columns + 1].flatten(3)


def offsets(rows: int, columns: int) -> Tensor:
    """Displacements (right, down) of the window's cells, in cells, (2, (2 rows + 1)(2 columns + 1))."""
    down, right = torch.meshgrid(torch.arange(-rows, rows + 1.0), torch.arange(-columns, columns + 1.0), indexing="ij")
    return torch.stack([right.flatten(), down.flatten()])


class FilledConv(nn.Conv2d):
    """A convolution whose inputs are filled up with zeros to a multiple of 4 channels: onnxruntime has a fast one for
    those."""

    def forward(self, input: Tensor) -> Tensor:
        """The same numbers as without."""
        batch, channels, height, width = input.shape
        missing = -channels % 4
        if missing == 0:
            return super().forward(input)
        weight = functional.pad(self.weight, (0, 0, 0, 0, 0, missing))
        filled = torch.cat([input, torch.zeros(batch, missing, height, width, device=input.device)], dim=1)
        return functional.conv2d(filled, weight, self.bias, self.stride, self.padding)


def two_convs(inputs: int, width: int) -> nn.Sequential:
    """Two 3x3 convolutions, each with a leaky ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, width, 3, padding=1),
        nn.LeakyReLU(SLOPE),
        nn.Conv2d(width, width, 3, padding=1),
        nn.LeakyReLU(SLOPE),
    )


def unit_vectors(features: Tensor) -> Tensor:
    """The vector of each cell, (B, C, H, W), scaled to length 1."""
    return features * torch.rsqrt((features * features).sum(dim=1, keepdim=True) + 1e-6)


def expected_displacement(scores: Tensor, window: Tensor, sharpness: Tensor) -> Tensor:
    """The mean displacement under the softmax of the scores, (B, 2, H, W), in cells of the scores' grid.

    Scores are cosines, so their exponentials need no largest one taken off, and one product gives both sums.
    """
    sums = torch.matmul(torch.exp(scores * sharpness), torch.cat([window, torch.ones_like(window[:1])]).T)
    return (sums[..., :2] / sums[..., 2:]).permute(0, 3, 1, 2)


def warped_back(before: Tensor, moved: Tensor) -> Tensor:
    """The previous fine features fetched from where each cell was; moved: (B, 2, H, W) in cells of twice the stride."""
    height, width = before.shape[2:]
    finer = functional.interpolate(moved, scale_factor=2.0, mode="bilinear", align_corners=False) * 2.0
    rows, columns = (torch.arange(count, device=before.device) + 0.0 for count in (height, width))
    v, u = torch.meshgrid(rows, columns, indexing="ij")
    x = (u + finer[:, 0] + 0.5) * (2.0 / width) - 1.0
    y = (v + finer[:, 1] + 0.5) * (2.0 / height) - 1.0
    where = torch.stack([x, y], dim=-1).clamp(-2.0, 2.0)
    return functional.grid_sample(before, where, mode="bilinear", padding_mode="zeros", align_corners=False)
