"""Adopts an ONNX detector made elsewhere: recognises its outputs, taps a feature tensor, leaves its numbers alone."""

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import ModelProto

from edgemap.export.errors import ExportError
from edgemap.export.onnx_export import input_shapes, shape_of
from edgemap.export.picodet import is_picodet, picodet_contract, trim
from edgemap.runtime.frames.class_names import COCO_NAMES, is_mapped
from edgemap.runtime.frames.reading import one_line, read_bytes
from edgemap.runtime.network.foreign import ForeignFile, recognise
from edgemap.runtime.network.manifest import ClassEntry, DetectorSpec, FeatureSpec, HeadSpec, InputSpec
from edgemap.runtime.network.network import Compute

CLASSES = tuple(ClassEntry(name=name, mapped=is_mapped(name)) for name in COCO_NAMES)


def class_entries(count: int) -> tuple[ClassEntry, ...]:
    """The classes of a detector with this many: COCO's for 80, else numbered names, all mapped."""
    return CLASSES if count == len(CLASSES) else tuple(ClassEntry(name=f"class {number}") for number in range(count))


MODEL_BYTES = 1 << 30
YOLOX_STRIDES = (8, 16, 32)
LOGARITHMS = 10.0  # of a width in cells: none of a picture is larger, and widths in pixels are
# Nodes that only rearrange, or that stand inside a convolution-activation pair: no features of their own.
NO_FEATURE = frozenset({"Conv", "Sigmoid", "Concat", "Slice", "Split", "Reshape", "Transpose", "Resize", "Constant"})


@dataclass(frozen=True)
class Tensor4:
    """A tensor of the graph with static shape (1, channels, height, width), and the kind of node that makes it."""

    name: str
    op: str
    channels: int
    height: int
    width: int

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(1, channels, height, width)."""
        return 1, self.channels, self.height, self.width

    def value(self) -> onnx.ValueInfoProto:
        """It as an output of the graph."""
        return onnx.helper.make_tensor_value_info(self.name, onnx.TensorProto.FLOAT, self.shape)


def load_onnx(path: Path) -> ModelProto:
    """Read and check an ONNX file. Raises ExportError."""
    try:
        model = onnx.load_from_string(read_bytes(path, ExportError, MODEL_BYTES))
        if any(item.data_location == onnx.TensorProto.EXTERNAL for item in model.graph.initializer):
            raise ExportError(f"{path}: keeps its weights in other files; save it as one file")
        onnx.checker.check_model(model)
    except (DecodeError, onnx.checker.ValidationError, UnicodeDecodeError, ValueError) as error:
        size = path.stat().st_size
        raise ExportError(f"{path}: not a whole ONNX model, {size:,} bytes ({one_line(error, 160)})") from None
    return model


def static_tensors(model: ModelProto) -> dict[str, Tensor4]:
    """All tensors of static shape (1, C, H, W) that nodes make, by name, in graph order."""
    graph = onnx.shape_inference.infer_shapes(model).graph
    shapes = {value.name: shape_of(value) for value in (*graph.value_info, *graph.output)}
    made = [(name, node.op_type, shapes.get(name, ())) for node in graph.node for name in node.output]
    return {
        name: Tensor4(name, op, *shape[1:])
        for name, op, shape in made
        if len(shape) == 4 and shape[0] == 1 and min(shape) > 0
    }


def only_outputs(model: ModelProto, tensors: Iterable[Tensor4]) -> ModelProto:
    """The model with these tensors as its outputs, in this order."""
    model = copy.deepcopy(model)
    del model.graph.output[:], model.graph.value_info[:]
    model.graph.output.extend(tensor.value() for tensor in tensors)
    return model


def find_tap(tensors: Mapping[str, Tensor4], stride: int, width: int, height: int) -> Tensor4:
    """The best feature tensor of a stride: the last of the widest activations before the next coarser grid.

    The coarsest stride has no coarser grid after it, so the result is the neck's last wide activation. Raises
    ExportError.
    """
    grid = (height // stride, width // stride)
    found: list[Tensor4] = []
    for tensor in tensors.values():
        if (tensor.height, tensor.width) == grid and tensor.op not in NO_FEATURE:
            found.append(tensor)
        if found and tensor.height * 2 == grid[0] and tensor.width * 2 == grid[1]:
            break
    if not found:
        raise ExportError(f"no feature tensor of stride {stride}: none has shape (1, C, {grid[0]}, {grid[1]})")
    return max(reversed(found), key=lambda tensor: tensor.channels)


def adopt(path: Path, feature: str | None = None) -> tuple[ModelProto, DetectorSpec]:
    """Recognise a detector and tap its feature tensor as one more output.

    feature: a tensor's name, or `stride8`, `stride16`, `stride32`; None taps nothing. Known are YOLOX's output, (1,
    cells of strides 8, 16, 32, 5 + classes) of BGR pictures, 0..255, letterboxed to the top left with grey 114, or
    recognised on pictures where the graph decodes its boxes itself; and PicoDet's (`export.picodet`). Raises
    ExportError, or BundleError where no reading of decoded boxes fits.
    """
    model, reading = load_onnx(path), None
    if is_picodet(model):
        model = trim(model)
        spec, heads, classes = picodet_contract(model)
        decode: Literal["yolox", "dfl", "reading"] = "dfl"
    else:
        spec, heads, classes = _yolox(model, path)
        decode = "yolox"
        file, names = ForeignFile(path, Compute()), [entry.name for entry in class_entries(classes)]
        black = np.zeros((1, 3, spec.height, spec.width), np.float32)
        if np.abs(file.run(black)[heads[0].name][..., 2:4]).max() > LOGARITHMS:
            best = recognise(file, names)
            spec, reading, decode = best.input, best.reading, "reading"
    detector = DetectorSpec(
        file="backbone.onnx",
        input=spec,
        decode=decode,
        heads=heads,
        features=() if feature is None else (_tap(model, path, feature, spec),),
        classes=class_entries(classes),
        reading=reading,
    )
    return model, detector


def tapped(model: ModelProto, detector: DetectorSpec, path: Path, feature: str | None) -> DetectorSpec:
    """The contract of a network of ours with that feature alone, and the model's outputs accordingly.

    feature: as for `adopt`, or `head` for the raw coarsest map. Raises ExportError.
    """
    coarsest = max(detector.heads, key=lambda head: head.strides[-1])
    spec = next((f for f in detector.features if feature in (f.name, f"stride{f.stride}")), None)
    if feature == "head" and len(coarsest.shape) == 4:
        spec = FeatureSpec(name=coarsest.name, shape=coarsest.shape, stride=coarsest.strides[0])
    shown = {head.name for head in detector.heads} | ({spec.name} if spec else set())
    for value in [value for value in model.graph.output if value.name not in shown]:
        model.graph.output.remove(value)
    if spec is None and feature is not None:
        spec = _tap(model, path, feature, detector.input)
    return msgspec.structs.replace(detector, features=() if spec is None else (spec,))


def _yolox(model: ModelProto, path: Path) -> tuple[InputSpec, tuple[HeadSpec, ...], int]:
    inputs, outputs = input_shapes(model), {value.name: shape_of(value) for value in model.graph.output}
    if [(len(shape), shape[:2]) for shape in inputs.values()] != [(4, (1, 3))]:
        raise ExportError(f"{path}: expected one input (1, 3, H, W) of fixed size, found {inputs}")
    ((picture, (_, _, height, width)),) = inputs.items()
    if height < 32 or width < 32 or height % 32 or width % 32:
        raise ExportError(f"{path}: input of {width}x{height} px, expected a fixed multiple of 32")
    cells = sum((height // stride) * (width // stride) for stride in YOLOX_STRIDES)
    name, shape = next(iter(outputs.items()))
    if len(outputs) != 1 or len(shape) != 3 or shape[:2] != (1, cells) or shape[2] < 6:
        raise ExportError(
            f"{path}: outputs {outputs} fit no known rule; yolox has one, (1, {cells}, 5 + classes); "
            "`edgemap run --bundle FILE.onnx` takes other detectors as they are"
        )
    spec = InputSpec(
        name=picture, width=width, height=height, resize="letterbox_topleft", colour="bgr", scale=1.0, pad=114
    )
    return spec, (HeadSpec(name=name, shape=shape, strides=YOLOX_STRIDES),), shape[2] - 5


def _tap(model: ModelProto, path: Path, feature: str, spec: InputSpec) -> FeatureSpec:
    tensors = static_tensors(model)
    named = tensors.get(feature)
    if named is None and feature.startswith("stride") and feature[6:].isdigit() and int(feature[6:]) > 0:
        try:
            named = find_tap(tensors, int(feature[6:]), spec.width, spec.height)
        except ExportError as error:
            raise ExportError(f"{path}: {error}") from None
    if named is None:
        raise ExportError(f"{path}: no tensor {feature!r} of static shape (1, C, H, W); {len(tensors)} others have one")
    stride = spec.width // named.width
    if (named.width * stride, named.height * stride) != (spec.width, spec.height):
        raise ExportError(
            f"{path}: tensor {feature!r} has {named.height}x{named.width} cells, no whole stride of the input"
        )
    if named.name not in {value.name for value in model.graph.output}:
        model.graph.output.append(named.value())
    return FeatureSpec(name=named.name, shape=named.shape, stride=stride)
