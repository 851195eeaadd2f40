"""PicoDet (PaddleDetection, Yu et al. 2021) as a bundle's backbone: its raw heads, and hard-swish as one operator."""

from typing import Any

import onnx
from onnx import ModelProto, NodeProto, version_converter

from edgemap.export.onnx_export import drop_unused, input_shapes, shape_of
from edgemap.runtime.network.foreign import IMAGENET
from edgemap.runtime.network.layouts import BINS, STRIDES
from edgemap.runtime.network.manifest import HeadSpec, InputSpec

SIDES = 4 * BINS
OPSET = 14  # the first with HardSwish; written as add, clip, multiply, divide it takes a third of the network's time


def is_picodet(model: ModelProto) -> bool:
    """Whether the outputs are PicoDet's: scores (1, cells, C) of four strides, then (1, cells, 32) of the same."""
    shapes = [shape_of(value) for value in model.graph.output]
    if len(shapes) != 2 * len(STRIDES) or any(len(shape) != 3 for shape in shapes):
        return False
    scores, sides = shapes[: len(STRIDES)], shapes[len(STRIDES) :]
    return all(s[1] == b[1] and b[2] == SIDES for s, b in zip(scores, sides, strict=True))


def trim(model: ModelProto) -> ModelProto:
    """The network cut after the last convolutions of its heads, (1, C+32, H, W), with hard-swish as one operator."""
    from onnxscript.rewriter import rewrite  # takes a second
    from onnxscript.rewriter.pattern import RewriteRule

    model = version_converter.convert_version(model, OPSET)
    model = rewrite(model, [RewriteRule(_hard_swish, lambda op, x: op.HardSwish(x))])
    graph = model.graph
    makers = {name: node for node in graph.node for name in node.output}
    heads = [_convolution_before(value.name, makers) for value in graph.output[len(STRIDES) :]]
    inferred = {value.name: value for value in onnx.shape_inference.infer_shapes(model).graph.value_info}
    del graph.output[:]
    graph.output.extend(inferred[node.output[0]] for node in heads)
    drop_unused(model)
    return model


def picodet_contract(model: ModelProto) -> tuple[InputSpec, tuple[HeadSpec, ...], int]:
    """Input, heads and number of classes of a trimmed network: RGB, ImageNet's mean and deviation, stretched."""
    name, (_, _, height, width) = next(iter(input_shapes(model).items()))
    heads = tuple(
        HeadSpec(name=value.name, shape=shape_of(value), strides=(stride,))
        for value, stride in zip(model.graph.output, STRIDES, strict=False)
    )
    spec = InputSpec(
        name=name, width=width, height=height, resize="stretch", colour="rgb", scale=1.0 / 255.0,
        mean=IMAGENET["mean"], std=IMAGENET["std"],
    )  # fmt: skip
    return spec, heads, heads[0].shape[1] - SIDES


def _hard_swish(op: Any, x: Any) -> Any:
    """Four operators that are one."""
    return op.Div(op.Mul(x, op.Clip(op.Add(x, 3.0), 0.0, 6.0)), 6.0)


def _convolution_before(name: str, makers: dict[str, NodeProto]) -> NodeProto:
    node = makers[name]
    while node.op_type != "Conv":
        node = makers[node.input[0]]
    return node
