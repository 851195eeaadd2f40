"""The floor head: a few small convolutions on a frozen detector's features of strides 4 to 32."""

import torch
from torch import Tensor, nn
from torch.nn import functional

LABELS = ("floor", "wall")
STRIDES = (4, 8, 16, 32)  # of the features that it reads, finest first
WIDTH, DETAIL = 48, 16  # channels of its maps of stride 8, and of those that it makes of the features of stride 4
DEEP = 2  # blocks at stride 32, where they cost least and see the room
COARSE = 3  # blocks at stride 16, where they cost little and see far
FINE = 2  # rows and columns of output cells in one of stride 8


class Unit(nn.Sequential):
    """Convolution, batch normalisation and, unless it is the last of a block, ReLU."""

    def __init__(self, channels: int, out: int, kernel: int = 1, stride: int = 1, groups: int = 1, relu: bool = True):
        padding = (kernel - stride + 1) // 2
        super().__init__(
            nn.Conv2d(channels, out, kernel, stride, padding, groups=groups, bias=False),
            nn.BatchNorm2d(out),
            *([nn.ReLU()] if relu else []),
        )


class Block(nn.Module):
    """A residual block: 5x5 depthwise, then 1x1."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.spread = Unit(width, width, 5, groups=width, relu=False)
        self.mix = Unit(width, width)

    def forward(self, x: Tensor, computed: Tensor | float = 1.0) -> Tensor:
        """The maps plus the block's residual. computed: 0 for rows that are as good as absent, (B, 1, H, 1)."""
        return x + self.mix(self.spread(x * computed))


class FloorHead(nn.Module):
    """Features (B, C, H, W) of strides 4, 8, 16, 32 to logits (B, 2, H, W) of stride 4: floor, wall.

    It works at stride 8, where features of stride 4 come in by a convolution of 2x2 and each cell gives 2x2 of the
    output: no convolution runs on the fine maps. channels: of the four features. rows: of those of stride 16, whose
    inputs then include the row of the picture and the mean of the coarsest features, as context of the room; 0 for a
    network whose rows are open: such a head needs none of them, so those that a picture does not reach may be left off.
    deep: blocks at stride 32.
    """

    def __init__(self, channels: tuple[int, ...], rows: int, width: int = WIDTH, deep: int = DEEP) -> None:
        super().__init__()
        self.channels, self.rows, self.width = channels, rows, width
        s4, s8, s16, s32 = channels
        self.from4 = Unit(s4, DETAIL, 2, 2)
        self.from8, self.from16, self.from32 = (Unit(count, width, relu=False) for count in (s8, s16, s32))
        if rows:
            self.row = nn.Parameter(torch.zeros(1, width, rows, 1))
            self.scene = nn.Conv2d(s32, width, 1)
        self.deep = nn.ModuleList(Block(width) for _ in range(deep))
        self.coarse = nn.ModuleList(Block(width) for _ in range(COARSE))
        self.context, self.detailed = Block(width), Unit(width + DETAIL, width)
        self.last = Block(width)
        self.out = nn.Conv2d(width, len(LABELS) * FINE * FINE, 1)

    def forward(self, s4: Tensor, s8: Tensor, s16: Tensor, s32: Tensor, computed: Tensor | None = None) -> Tensor:
        """The logits. computed: of the coarsest rows the network computed, (B, H32) of 0 and 1; default: all."""
        rows = (1.0, 1.0, 1.0) if computed is None else (_rows(computed, one.shape[2]) for one in (s8, s16, s32))
        at8, at16, at32 = rows
        x = self.from32(s32)
        for number, block in enumerate(self.deep):
            x = block(x if number else functional.relu(x), at32)
        x = self.from16(s16) + _twice(x)
        if self.rows:
            x = x + self.row + self.scene(s32.mean((2, 3), keepdim=True))
        x = functional.relu(x)
        for block in self.coarse:
            x = block(x, at16)
        x = self.context(functional.relu(self.from8(s8) + _twice(x)), at8)
        x = self.last(self.detailed(torch.cat([x, self.from4(s4)], dim=1)), at8)
        return functional.pixel_shuffle(self.out(x), FINE)


def _twice(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


def _rows(computed: Tensor, rows: int) -> Tensor:
    """(B, H32) as (B, 1, rows, 1)."""
    return computed.repeat_interleave(rows // computed.shape[1], dim=1)[:, None, :, None]
