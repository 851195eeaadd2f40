"""A Darknet cfg as a torch network: layers in file order, detection heads coarse first, raw logits out."""

import math
from pathlib import Path

from torch import Tensor, nn

from edgemap.export import darknet_layers as layers
from edgemap.export.darknet_cfg import Section, parse_cfg
from edgemap.export.darknet_layers import Shape, Yolo
from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import read_text

FORK_KEYS = frozenset({"iou_loss", "cls_normalizer", "iou_normalizer", "scale_x_y", "nms_kind"})
CELL_LIMIT = 1 << 26  # values of one layer
WEIGHT_LIMIT = 1 << 27  # YOLOv3 has 62 million
WIDEST_NECK = 512  # channels; the paper's other feature matrix is 13x13x512 (section 4.5)


class Darknet(nn.Module):
    """A network of a cfg file (Path) or text. size: (width, height) in px instead of the cfg's. Raises ExportError.

    Takes (1, 3, height, width) float32 RGB in 0..1; gives the outputs of `outputs` (layer indices), by default the raw
    logits (1, A*(5+C), H, W) of every yolo head, coarsest first. shapes: (C, H, W) after each layer. letterbox: whether
    pictures keep their aspect; else they are stretched.
    """

    def __init__(self, cfg: Path | str, size: tuple[int, int] | None = None) -> None:
        super().__init__()
        sections = parse_cfg(read_text(cfg, ExportError), cfg.name) if isinstance(cfg, Path) else parse_cfg(cfg)
        net = sections[0]
        self.name = net.file
        self.channels = net.integer("channels", 3, least=1)
        self.width, self.height = size or (net.integer("width", least=1), net.integer("height", least=1))
        self.letterbox = _letterboxes(sections)
        if self.channels * self.width * self.height > CELL_LIMIT:
            raise ExportError(f"{self.name}: input of {self.channels}x{self.height}x{self.width} is too large")
        self.shapes: list[Shape] = []
        self._weights = 0
        self.heads: list[Yolo] = []
        self.layers = nn.ModuleList()
        for section in sections[1:]:
            layer, shape = self._build(section)
            if math.prod(shape) > CELL_LIMIT:
                raise ExportError(f"{section.where} makes {shape} values, at most {CELL_LIMIT:,} in one layer")
            self.layers.append(layer)
            self.shapes.append(shape)
        if not self.heads:
            raise ExportError(f"{self.name}: has no [yolo] layer, so no detections")
        if len({head.classes for head in self.heads}) != 1:
            raise ExportError(f"{self.name}: [yolo] layers differ in classes ({[h.classes for h in self.heads]})")
        self.heads.sort(key=lambda head: head.shape[1])
        self.outputs = tuple(head.layer for head in self.heads)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """(1, 3, height, width) in 0..1 to the tensors of `outputs`."""
        done: list[Tensor] = []
        for layer in self.layers:
            done.append(layer(*(image if source < 0 else done[source] for source in layer.sources)))  # type: ignore[union-attr]
        return tuple(done[index] for index in self.outputs)

    def convolutions(self) -> list[layers.Convolution]:
        """All convolutions in file order: the order of the weights file."""
        return [module for module in self.modules() if isinstance(module, layers.Convolution)]

    def stride(self, layer: int) -> int:
        """Input px per cell of a layer's output. Raises ExportError where the two axes differ."""
        _, height, width = self.shapes[layer]
        stride = self.width // width
        if (width * stride, height * stride) != (self.width, self.height):
            raise ExportError(
                f"{self.name}: layer {layer} has {height}x{width} cells, "
                f"no whole stride of a {self.width}x{self.height} input"
            )
        return stride

    def feature_layer(self, feature: str) -> int:
        """The layer of a feature name.

        `head`: the coarsest head's raw logits (the paper's 13x13x255). `neck`: the last layer before that head with its
        grid and at most 512 channels (the paper's 13x13x512). `stride8`, `stride16`, …: the last layer of that stride
        before the next downsampling. `layer:N`. Raises ExportError.
        """
        head = self.heads[0]
        kind, _, number = feature.partition(":")
        if feature == "head":
            return head.layer
        if feature == "neck":
            for index in range(head.layer - 1, -1, -1):
                if self.shapes[index][1:] == head.shape[1:] and self.shapes[index][0] <= WIDEST_NECK:
                    return index
        elif kind == "layer" and number.isdigit() and int(number) < len(self.shapes):
            return int(number)
        elif feature.startswith("stride") and feature[6:].isdigit():
            cells = (self.height // int(feature[6:]), self.width // int(feature[6:]))
            for index in range(len(self.shapes) - 1):
                if self.shapes[index][1:] == cells and self.shapes[index + 1][1] < cells[0]:
                    return index
        raise ExportError(f"{self.name}: has no feature {feature!r}; there are head, neck, stride8, stride16, layer:N")

    def _build(self, section: Section) -> tuple[layers.Layer, Shape]:
        index = len(self.shapes)
        shape = self.shapes[-1] if self.shapes else (self.channels, self.height, self.width)
        joins = {"route": self._route, "shortcut": self._shortcut, "yolo": self._yolo}
        if section.kind not in (known := layers.BUILDERS | joins):
            raise ExportError(f"{section.where} is not a layer that edgemap reads ({', '.join(known)})")
        for key in layers.FOREIGN:
            if section.integer(key, 0):
                raise ExportError(f"{section.where} {key}={section.text(key)} is not supported")
        if section.kind == "convolutional":
            self._weights += layers.weight_count(section, shape)
            if self._weights > WEIGHT_LIMIT:
                raise ExportError(f"{section.where} makes more than {WEIGHT_LIMIT:,} weights")
        return known[section.kind](section, shape, index - 1)

    def _sources(self, section: Section, key: str, index: int) -> list[int]:
        sources = [number if number >= 0 else index + number for number in section.numbers(key, int)]
        if not sources or any(not 0 <= source < index for source in sources):
            raise ExportError(
                f"{section.where} {key}={section.text(key)}: this is layer {index}, sources are 0 to {index - 1}"
            )
        return sources

    def _route(self, section: Section, _: Shape, before: int) -> tuple[layers.Layer, Shape]:
        sources = self._sources(section, "layers", before + 1)
        groups, group = section.integer("groups", 1, least=1), section.integer("group_id", 0, least=0)
        shapes = [self.shapes[source] for source in sources]
        if len({shape[1:] for shape in shapes}) != 1:
            sizes = ", ".join(f"{source}: {s[1]}x{s[2]}" for source, s in zip(sources, shapes, strict=True))
            raise ExportError(f"{section.where} joins layers of different sizes ({sizes})")
        if group >= groups or any(shape[0] % groups for shape in shapes):
            raise ExportError(
                f"{section.where} group_id={group} of groups={groups} does not fit {[s[0] for s in shapes]} channels"
            )
        channels = sum(shape[0] // groups for shape in shapes)
        return layers.Layer(sources, layers.Route(groups, group)), (channels, *shapes[0][1:])

    def _shortcut(self, section: Section, shape: Shape, before: int) -> tuple[layers.Layer, Shape]:
        if section.text("weights_type", "none") != "none":
            raise ExportError(f"{section.where} weights_type={section.text('weights_type')} is not supported")
        sources = self._sources(section, "from", before + 1)
        for source in sources:
            if self.shapes[source] != shape:
                raise ExportError(
                    f"{section.where} adds layer {source} of shape {self.shapes[source]} to shape {shape}"
                )
        added = layers.Shortcut(layers.activation(section, "linear"))
        return layers.Layer([before, *sources], added), shape

    def _yolo(self, section: Section, shape: Shape, before: int) -> tuple[layers.Layer, Shape]:
        flat, classes = section.numbers("anchors", float), section.integer("classes", 20, least=1)
        if len(flat) % 2:
            raise ExportError(f"{section.where} anchors= holds {len(flat)} numbers, not pairs")
        pairs = list(zip(flat[0::2], flat[1::2], strict=True))
        mask = section.numbers("mask", int) if "mask" in section.options else tuple(range(len(pairs)))
        if any(not 0 <= number < len(pairs) for number in mask):
            raise ExportError(f"{section.where} mask={section.text('mask')} points outside of {len(pairs)} anchors")
        expected = len(mask) * (classes + 5)
        if shape[0] != expected:
            raise ExportError(
                f"{section.where} needs {expected} filters before it ({len(mask)} anchors x ({classes} classes + 5)), "
                f"found {shape[0]}"
            )
        anchors = tuple(pairs[number] for number in mask)
        if not pairs or not all(side > 0.0 for pair in pairs for side in pair):
            raise ExportError(f"{section.where} anchors={section.text('anchors')}: sides must be positive")
        self.heads.append(Yolo(before, classes, anchors, section.number("scale_x_y", 1.0), shape))
        return layers.Layer([before]), shape


def _letterboxes(sections: list[Section]) -> bool:
    """Darknet letterboxes; its fork of YOLOv4's authors, known by keys of its own, stretches unless letter_box=1."""
    if "letter_box" in sections[0].options:
        return sections[0].integer("letter_box") != 0
    return not any(FORK_KEYS & set(section.options) for section in sections if section.kind == "yolo")
