"""Darknet's layers as torch modules: each builder reads one cfg section and infers its output shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from edgemap.export.darknet_cfg import Section
from edgemap.export.errors import ExportError

Shape = tuple[int, int, int]  # channels, height, width

# As OpenCV's importer has it, nearest to Darknet's CPU code (1e-6 on the square root; its GPU code: 1e-5 on the
# variance). The choice moves YOLOv3-tiny's logits, which reach 19, by up to 0.004.
BATCH_NORM_EPSILON = 1e-6

ACTIVATIONS: dict[str, Callable[[], nn.Module]] = {
    "linear": nn.Identity,
    "leaky": lambda: nn.LeakyReLU(0.1),
    "relu": nn.ReLU,
    "relu6": nn.ReLU6,
    "mish": nn.Mish,
    "swish": nn.SiLU,
    "logistic": nn.Sigmoid,
    "tanh": nn.Tanh,
    "elu": nn.ELU,
    "hardtan": nn.Hardtanh,
}
# Options that change what a layer computes and that this reader does not know.
FOREIGN = (
    "stride_x",
    "stride_y",
    "binary",
    "xnor",
    "antialiasing",
    "share_index",
    "rotate",
    "deform",
    "reverse",
    "flipped",
)


class Layer(nn.Module):
    """A module that reads the outputs of `sources` (absolute layer indices; -1 is the network's input)."""

    def __init__(self, sources: Sequence[int], module: nn.Module | None = None) -> None:
        """module: nothing for what passes its source on: dropout when a trained network runs, and a head's marker."""
        super().__init__()
        self.sources, self.module = tuple(sources), module or nn.Identity()

    def forward(self, *parts: Tensor) -> Tensor:
        """The sources' outputs, (1, C, H, W) each, to one."""
        return self.module(*parts)


class Convolution(nn.Module):
    """Convolution, optional batch normalisation, activation."""

    def __init__(self, conv: nn.Conv2d, norm: nn.BatchNorm2d | None, activation: nn.Module) -> None:
        super().__init__()
        self.conv, self.norm, self.activation = conv, norm, activation

    def forward(self, x: Tensor) -> Tensor:
        """(1, C, H, W) to (1, filters, H', W')."""
        x = self.conv(x)
        return self.activation(x if self.norm is None else self.norm(x))


class Route(nn.Module):
    """Concatenation over channels of one group of each source."""

    def __init__(self, groups: int, group: int) -> None:
        super().__init__()
        self.groups, self.group = groups, group

    def forward(self, *parts: Tensor) -> Tensor:
        """Several (1, C_i, H, W) to (1, sum of C_i / groups, H, W)."""
        if self.groups > 1:
            parts = tuple(part.chunk(self.groups, dim=1)[self.group] for part in parts)
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)


class Shortcut(nn.Module):
    """Sum of equal shapes, then an activation."""

    def __init__(self, activation: nn.Module) -> None:
        super().__init__()
        self.activation = activation

    def forward(self, x: Tensor, *others: Tensor) -> Tensor:
        """Several (1, C, H, W) to one."""
        return self.activation(sum(others, x))


@dataclass(frozen=True)
class Yolo:
    """A detection head of the cfg. layer: index whose output holds the raw logits. anchors: (w, h) in input px."""

    layer: int
    classes: int
    anchors: tuple[tuple[float, float], ...]
    scale_xy: float
    shape: Shape


def activation(section: Section, default: str) -> nn.Module:
    """The section's activation. Raises ExportError for one that is unknown."""
    name = section.text("activation", default)
    if name not in ACTIVATIONS:
        raise ExportError(f"{section.where} activation={name[:40]} is not one of {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]()


def weight_count(section: Section, shape: Shape) -> int:
    """Weights of a `[convolutional]`, known before memory is taken for them."""
    filters, size = section.integer("filters", least=1), section.integer("size", 1, least=1)
    return shape[0] // section.integer("groups", 1, least=1) * filters * size * size


def convolutional(section: Section, shape: Shape, source: int) -> tuple[Layer, Shape]:
    """`[convolutional]`: padding is size/2 under pad=1, else `padding`; both grow with the dilation."""
    channels, height, width = shape
    filters, size = section.integer("filters", least=1), section.integer("size", 1, least=1)
    stride, groups = section.integer("stride", 1, least=1), section.integer("groups", 1, least=1)
    dilation = section.integer("dilation", 1, least=1)
    padding = size // 2 if section.integer("pad", 0) else section.integer("padding", 0, least=0)
    if channels % groups or filters % groups:
        raise ExportError(f"{section.where} groups={groups} does not divide {channels} channels into {filters} filters")
    normalised = bool(section.integer("batch_normalize", 0))
    reach = dilation * (size - 1) + 1
    out_height = (height + 2 * padding * dilation - reach) // stride + 1
    out_width = (width + 2 * padding * dilation - reach) // stride + 1
    if out_height < 1 or out_width < 1:
        raise ExportError(f"{section.where} size={size} does not fit into {height}x{width} cells")
    conv = nn.Conv2d(channels, filters, size, stride, padding * dilation, dilation, groups, bias=not normalised)
    norm = nn.BatchNorm2d(filters, eps=BATCH_NORM_EPSILON) if normalised else None
    layer = Layer([source], Convolution(conv, norm, activation(section, "logistic")))
    return layer, (filters, out_height, out_width)


def maxpool(section: Section, shape: Shape, source: int) -> tuple[Layer, Shape]:
    """`[maxpool]`: (cells + padding - size) / stride + 1 with padding = size - 1, unless the cfg says otherwise.

    Half of the padding, rounded down, comes before, the rest behind; it never wins.
    """
    stride = section.integer("stride", 1, least=1)
    size = section.integer("size", stride, least=1)
    padding = section.integer("padding", size - 1, least=0)
    before = padding // 2
    out, pads = [], []
    for cells in shape[1:]:
        count = (cells + padding - size) // stride + 1
        if count < 1:
            raise ExportError(f"{section.where} size={size} does not fit into {shape[1]}x{shape[2]} cells")
        out.append(count)
        pads.append(max(0, (count - 1) * stride + size - cells - before))
    pool: nn.Module = nn.MaxPool2d(size, stride)
    if before or any(pads):
        pool = nn.Sequential(nn.ConstantPad2d((before, pads[1], before, pads[0]), float("-inf")), pool)
    return Layer([source], pool), (shape[0], out[0], out[1])


def upsample(section: Section, shape: Shape, source: int) -> tuple[Layer, Shape]:
    """`[upsample]`."""
    factor = section.integer("stride", 2, least=1)
    if section.number("scale", 1.0) != 1.0:
        raise ExportError(f"{section.where} scale={section.text('scale')} is not supported, only 1")
    return Layer([source], nn.Upsample(scale_factor=float(factor))), (shape[0], shape[1] * factor, shape[2] * factor)


BUILDERS = {  # of layers that read the one before: section, shape and index of that to layer and shape
    "convolutional": convolutional,
    "maxpool": maxpool,
    "upsample": upsample,
    "avgpool": lambda _, shape, source: (Layer([source], nn.AdaptiveAvgPool2d(1)), (shape[0], 1, 1)),
    "dropout": lambda _, shape, source: (Layer([source]), shape),
}
