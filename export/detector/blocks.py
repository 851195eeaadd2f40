"""Layers of YOLOX-Nano (Ge et al. 2021): depthwise-separable convolutions, cross-stage blocks, pyramid pooling; and one
of our own that deepens it."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn


class Conv(nn.Module):
    """Convolution with bias, optional batch normalisation, SiLU. norm=False: normalisation stands in the weights."""

    def __init__(self, inputs: int, outputs: int, size: int, stride: int = 1, groups: int = 1, norm: bool = True):
        super().__init__()
        # A 6x6 stride-2 kernel with 2 px of padding is YOLOX's space-to-depth followed by 3x3.
        padding = (size - stride) // 2 if size == 6 else size // 2
        self.conv = nn.Conv2d(inputs, outputs, size, stride, padding, groups=groups, bias=not norm)
        self.norm: nn.Module = nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.03) if norm else nn.Identity()
        self.activation = nn.SiLU(inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, H/stride, W/stride)."""
        return self.activation(self.norm(self.conv(x)))


class Separable(nn.Module):
    """Depthwise 3x3, then pointwise."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, norm: bool = True) -> None:
        super().__init__()
        self.depthwise = Conv(inputs, inputs, 3, stride, groups=inputs, norm=norm)
        self.pointwise = Conv(inputs, outputs, 1, norm=norm)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, H/stride, W/stride)."""
        return self.pointwise(self.depthwise(x))


class Bottleneck(nn.Module):
    """1x1, separable 3x3, and the input added where `residual`."""

    def __init__(self, channels: int, residual: bool, norm: bool) -> None:
        super().__init__()
        self.reduce = Conv(channels, channels, 1, norm=norm)
        self.spread = Separable(channels, channels, norm=norm)
        self.residual = residual

    def forward(self, x: Tensor) -> Tensor:
        """Shape stays."""
        y = self.spread(self.reduce(x))
        return x + y if self.residual else y


class CrossStage(nn.Module):
    """Half of the channels through bottlenecks, half past them (CSP with three convolutions)."""

    def __init__(self, inputs: int, outputs: int, blocks: int, residual: bool = True, norm: bool = True) -> None:
        super().__init__()
        self.main = Conv(inputs, outputs // 2, 1, norm=norm)
        self.past = Conv(inputs, outputs // 2, 1, norm=norm)
        self.blocks = nn.Sequential(*(Bottleneck(outputs // 2, residual, norm) for _ in range(blocks)))
        self.join = Conv(outputs, outputs, 1, norm=norm)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, H, W)."""
        main, past = self.main(x), self.past(x)
        return self.join(torch.cat([self.blocks(main), past], dim=1))


class PyramidPool(nn.Module):
    """Maxima over 5, 9 and 13 cells beside the input (spatial pyramid pooling)."""

    def __init__(self, channels: int, norm: bool) -> None:
        super().__init__()
        self.reduce = Conv(channels, channels // 2, 1, norm=norm)
        self.pools = nn.ModuleList(nn.MaxPool2d(size, 1, size // 2) for size in (5, 9, 13))
        self.join = Conv(channels * 2, channels, 1, norm=norm)

    def forward(self, x: Tensor) -> Tensor:
        """Shape stays."""
        x = self.reduce(x)
        return self.join(torch.cat([x, *(pool(x) for pool in self.pools)], dim=1))


class Refinement(nn.Module):
    """1x1 to half the channels and 3x3 back, added to the input: depth that a network may grow later.

    The last weights start at zero, so that the network first computes what it did without it.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.reduce = nn.Conv2d(channels, channels // 2, 1)
        self.spread = nn.Conv2d(channels // 2, channels, 3, padding=1)
        self.activation = nn.SiLU(inplace=True)
        nn.init.zeros_(self.spread.weight)
        assert self.spread.bias is not None
        nn.init.zeros_(self.spread.bias)

    def forward(self, x: Tensor) -> Tensor:
        """Shape stays."""
        return x + self.spread(self.activation(self.reduce(x)))


def convolutions(module: nn.Module) -> Iterator[Conv]:
    """All `Conv` in the order they were made, which is the order of execution."""
    yield from (part for part in module.modules() if isinstance(part, Conv))


def fold_norms(module: nn.Module) -> None:
    """Fold every batch normalisation into its convolution, in place and in float64."""
    with torch.no_grad():
        for part in convolutions(module):
            norm, conv = part.norm, part.conv
            if not isinstance(norm, nn.BatchNorm2d):
                continue
            assert norm.running_mean is not None
            assert norm.running_var is not None
            factor = norm.weight.double() / torch.sqrt(norm.running_var.double() + norm.eps)
            bias = 0.0 if conv.bias is None else conv.bias.double()
            conv.weight.copy_(conv.weight.double() * factor[:, None, None, None])
            conv.bias = nn.Parameter((norm.bias.double() + (bias - norm.running_mean.double()) * factor).float())
            part.norm = nn.Identity()
