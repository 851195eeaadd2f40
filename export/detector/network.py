"""`edgemap-nano`: YOLOX-Nano's trunk, a refinement of its maps, and YOLOv3 heads of one anchor at strides 8, 16, 32."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from edgemap.export.detector.blocks import Conv, CrossStage, PyramidPool, Refinement, Separable

STRIDES = (8, 16, 32)
WIDTHS = (64, 128, 256)  # channels of the trunk at these strides
EARLY_WIDTH = 32  # channels of the first layers, stride 4
HIDDEN = 64  # channels of each head's branches
# Side of each stride's square anchor, px: the middle of the sizes that assignment gives to this stride.
ANCHORS = ((24.0, 24.0), (64.0, 64.0), (192.0, 192.0))
# A cell may speak for an object whose centre lies up to 2.5 cells off its own: (6 - 1) / 2 (Darknet's scale_x_y).
SCALE_XY = 6.0


class Head(nn.Module):
    """One stride's decoupled branches, joined into one raw YOLOv3 map (B, 5 + classes, H, W): x, y, w, h, obj, cls."""

    def __init__(self, inputs: int, classes: int, norm: bool) -> None:
        super().__init__()
        self.stem = Conv(inputs, HIDDEN, 1, norm=norm)
        self.class_branch = nn.Sequential(Separable(HIDDEN, HIDDEN, norm=norm), Separable(HIDDEN, HIDDEN, norm=norm))
        self.box_branch = nn.Sequential(Separable(HIDDEN, HIDDEN, norm=norm), Separable(HIDDEN, HIDDEN, norm=norm))
        self.classes = nn.Conv2d(HIDDEN, classes, 1)
        self.boxes = nn.Conv2d(HIDDEN, 4, 1)
        self.objectness = nn.Conv2d(HIDDEN, 1, 1)
        for conv in (self.classes, self.objectness):
            nn.init.constant_(conv.bias, -math.log((1 - 0.01) / 0.01))  # type: ignore[arg-type]

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to logits (B, 5 + classes, H, W)."""
        x = self.stem(x)
        boxes = self.box_branch(x)
        return torch.cat([self.boxes(boxes), self.objectness(boxes), self.classes(self.class_branch(x))], dim=1)


class Nano(nn.Module):
    """The whole network: BGR 0..255 pictures (B, 3, H, W) to raw heads of strides 8, 16, 32.

    norm: with batch normalisation (training from scratch), or without (start weights that have it folded in).
    """

    def __init__(self, classes: int, norm: bool = True) -> None:
        super().__init__()
        self.class_count, self.norm = classes, norm
        self.stem = Conv(3, 16, 6, stride=2, norm=norm)
        self.down4 = nn.Sequential(Separable(16, 32, 2, norm), CrossStage(32, 32, 1, norm=norm))
        self.down8 = nn.Sequential(Separable(32, 64, 2, norm), CrossStage(64, 64, 3, norm=norm))
        self.down16 = nn.Sequential(Separable(64, 128, 2, norm), CrossStage(128, 128, 3, norm=norm))
        self.down32 = nn.Sequential(
            Separable(128, 256, 2, norm), PyramidPool(256, norm), CrossStage(256, 256, 1, residual=False, norm=norm)
        )
        self.narrow32 = Conv(256, 128, 1, norm=norm)
        self.join16 = CrossStage(256, 128, 1, residual=False, norm=norm)
        self.narrow16 = Conv(128, 64, 1, norm=norm)
        self.join8 = CrossStage(128, 64, 1, residual=False, norm=norm)
        self.step16 = Separable(64, 64, 2, norm)
        self.out16 = CrossStage(128, 128, 1, residual=False, norm=norm)
        self.step32 = Separable(128, 128, 2, norm)
        self.out32 = CrossStage(256, 256, 1, residual=False, norm=norm)
        self.refinements = nn.ModuleList(Refinement(width) for width in WIDTHS)
        self.heads = nn.ModuleList(Head(width, classes, norm) for width in WIDTHS)
        self.upsample = nn.Upsample(scale_factor=2, mode="nearest")

    def early(self, image: Tensor) -> Tensor:
        """The first layers: 32 channels at stride 4. Fine-tuning leaves them alone."""
        return self.down4(self.stem(image))

    def late(self, x4: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """From `early` to the three maps that are refined: 64 channels at stride 8, 128 at 16, 256 at 32."""
        x8 = self.down8(x4)
        x16 = self.down16(x8)
        n32 = self.narrow32(self.down32(x16))
        n16 = self.narrow16(self.join16(torch.cat([self.upsample(n32), x16], dim=1)))
        p8 = self.join8(torch.cat([self.upsample(n16), x8], dim=1))
        p16 = self.out16(torch.cat([self.step16(p8), n16], dim=1))
        p32 = self.out32(torch.cat([self.step32(p16), n32], dim=1))
        return p8, p16, p32

    def trunk(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Pictures to the three maps that are refined."""
        return self.late(self.early(image))

    def look(self, maps: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """The trunk's maps, refined, to raw heads, finest first."""
        return tuple(head(refine(x)) for head, refine, x in zip(self.heads, self.refinements, maps, strict=True))

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Raw heads, finest first."""
        return self.look(self.trunk(image))


class WithFeatures(nn.Module):
    """The network as it is exported: heads coarsest first, then features: strides 4 (the first layers') or 8."""

    def __init__(self, network: Nano, strides: Sequence[int] = ()) -> None:
        super().__init__()
        self.network, self.strides = network, tuple(strides)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """(1, 3, H, W) to head_stride32, head_stride16, head_stride8 and the maps of the asked strides."""
        early = self.network.early(image)
        maps = self.network.late(early)
        return *self.network.look(maps)[::-1], *({4: early, 8: maps[0]}[stride] for stride in self.strides)
