"""Joins a floor head to the graph of its detector: one more output, all others as they were."""

import copy
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import onnx
import torch
from onnx import ModelProto, NodeProto, helper, numpy_helper
from torch import nn

from edgemap.export.adopt import Tensor4, find_tap, static_tensors
from edgemap.export.errors import ExportError
from edgemap.export.floor.head import FINE, LABELS, STRIDES, Block, FloorHead, Unit
from edgemap.runtime.network.manifest import DetectorSpec, FloorSpec
from edgemap.runtime.network.open_bundle import keep_outputs

OUTPUT = "floor"
# Of the networks that we know, by strides 4 to 32: the ends of the stages before the neck, which hold more of the floor
# than what the neck keeps for boxes; or those of the neck.
KNOWN = (
    ("batch_norm_3.tmp_4", "concat_4.tmp_0", "concat_17.tmp_0", "concat_22.tmp_0"),  # PicoDet-S, stages
    ("feature_stride4", "add_7", "add_8", "add_9"),  # edgemap-nano, neck
    ("input.67", "input.471", "input.531", "input.591"),  # YOLOX-Nano, neck
)


def floor_taps(model: ModelProto, detector: DetectorSpec) -> tuple[Tensor4, ...]:
    """The features that a floor head reads, strides 4 to 32: those listed for the backbone, else the widest of each
    stride.
    """
    tensors = static_tensors(model)
    for names in KNOWN:
        if all(name in tensors for name in names):
            return tuple(tensors[name] for name in names)
    size = detector.input
    return tuple(find_tap(tensors, stride, size.width, size.height) for stride in STRIDES)


def with_floor(
    model: ModelProto, detector: DetectorSpec, head: FloorHead, taps: Sequence[str]
) -> tuple[ModelProto, DetectorSpec]:
    """The model with the head's probabilities as its output `floor`, and its contract. Raises ExportError."""
    tensors = static_tensors(model)
    if (found := tuple(tensors[name].channels for name in taps)) != head.channels:
        raise ExportError(f"floor head: reads features of {head.channels} channels, the network's have {found}")
    merged, graph = copy.deepcopy(model), _Emitter()
    stride = STRIDES[1] // FINE
    shape = (1, len(LABELS), detector.input.height // stride, detector.input.width // stride)
    graph.head(head.eval(), taps)
    merged.graph.node.extend(graph.nodes)
    merged.graph.initializer.extend(graph.constants)
    value = helper.make_tensor_value_info(OUTPUT, onnx.TensorProto.FLOAT, shape)
    merged.graph.output.insert(len(detector.heads), value)
    spec = FloorSpec(name=OUTPUT, shape=shape, stride=stride, labels=LABELS)
    return merged, msgspec.structs.replace(detector, floor=spec)


def without_floor(model: ModelProto, detector: DetectorSpec) -> tuple[ModelProto, DetectorSpec]:
    """The model without its floor output and what only that needs, and its contract."""
    if detector.floor is None:
        return model, detector
    bare = copy.deepcopy(model)
    keep_outputs(bare.graph, {value.name for value in bare.graph.output} - {detector.floor.name})
    return bare, msgspec.structs.replace(detector, floor=None)


class _Emitter:
    """Writes a head as ONNX nodes, batch normalisation folded into the weights; operators that opset 11 has."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def head(self, head: FloorHead, taps: Sequence[str]) -> None:
        s4, s8, s16, s32 = taps
        x = self._unit(head.from32, s32)
        for number, block in enumerate(head.deep):
            assert isinstance(block, Block)
            x = self._block(block, x if number else self._add("Relu", [x]))
        x = self._add("Add", [self._unit(head.from16, s16), self._twice(x)])
        if head.rows:
            x = self._add("Add", [x, self._constant(head.row.detach().numpy())])
            x = self._add("Add", [x, self._convolution(head.scene, self._add("GlobalAveragePool", [s32]))])
        x = self._add("Relu", [x])
        for block in head.coarse:
            assert isinstance(block, Block)
            x = self._block(block, x)
        x = self._add("Add", [self._unit(head.from8, s8), self._twice(x)])
        x = self._block(head.context, self._add("Relu", [x]))
        x = self._unit(head.detailed, self._add("Concat", [x, self._unit(head.from4, s4)], axis=1))
        x = self._convolution(head.out, self._block(head.last, x))
        x = self._add("DepthToSpace", [x], blocksize=FINE, mode="CRD")
        self._add("Sigmoid", [x], name=OUTPUT)

    def _block(self, block: Block, x: str) -> str:
        return self._add("Add", [x, self._unit(block.mix, self._unit(block.spread, x))])

    def _unit(self, unit: Unit, x: str) -> str:
        convolution, norm = unit[0], unit[1]
        assert isinstance(convolution, nn.Conv2d)
        assert isinstance(norm, nn.BatchNorm2d)
        x = self._convolution(torch.nn.utils.fuse_conv_bn_eval(convolution, norm), x)
        return self._add("Relu", [x]) if len(unit) > 2 else x

    def _convolution(self, convolution: nn.Conv2d, x: str) -> str:
        assert convolution.bias is not None
        weight, bias = (tensor.detach().numpy() for tensor in (convolution.weight, convolution.bias))
        (pad, _), stride = convolution.padding, list(convolution.stride)  # type: ignore[misc]
        options = {"kernel_shape": list(weight.shape[2:]), "strides": stride, "pads": [pad] * 4}
        inputs = [x, self._constant(weight), self._constant(bias)]
        return self._add("Conv", inputs, group=convolution.groups, **options)

    def _twice(self, x: str) -> str:
        nothing = self._constant(np.zeros(0, np.float32))
        scales = self._constant(np.array([1.0, 1.0, 2.0, 2.0], np.float32))
        options = {"mode": "nearest", "nearest_mode": "floor", "coordinate_transformation_mode": "asymmetric"}
        return self._add("Resize", [x, nothing, scales], **options)

    def _constant(self, value: np.ndarray) -> str:
        name = f"{OUTPUT}.constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def _add(self, op: str, inputs: Sequence[str], name: str = "", **options: Any) -> str:
        name = name or f"{OUTPUT}.{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, list(inputs), [name], name=name, **options))
        return name
