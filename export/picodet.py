"""PicoDet (PaddleDetection, Yu et al. 2021) as a bundle's backbone: its raw heads, and hard-swish as one operator."""

import onnx
from onnx import ModelProto, NodeProto, helper, numpy_helper, version_converter

from edgemap.export.onnx_export import drop_unused, shape_of
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
    model = version_converter.convert_version(model, OPSET)
    _fuse_hard_swish(model)
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
    constants = {item.name for item in model.graph.initializer}
    picture = next(value for value in model.graph.input if value.name not in constants)
    _, _, height, width = shape_of(picture)
    heads = tuple(
        HeadSpec(name=value.name, shape=shape_of(value), strides=(stride,))
        for value, stride in zip(model.graph.output, STRIDES, strict=False)
    )
    spec = InputSpec(
        name=picture.name, width=width, height=height, resize="stretch", colour="rgb", scale=1.0 / 255.0,
        mean=IMAGENET["mean"], std=IMAGENET["std"],
    )  # fmt: skip
    return spec, heads, heads[0].shape[1] - SIDES


def _fuse_hard_swish(model: ModelProto) -> None:
    """x * clip(x + 3, 0, 6) / 6, four operators, is one."""
    graph = model.graph
    makers = {name: node for node in graph.node for name in node.output}
    values = {item.name: numpy_helper.to_array(item) for item in graph.initializer}
    values |= {n.output[0]: numpy_helper.to_array(n.attribute[0].t) for n in graph.node if n.op_type == "Constant"}

    def constant(node: NodeProto, *expected: float) -> bool:
        found = [values.get(name) for name in node.input[1:]]
        return all(v is not None and v.size == 1 and v.item() == e for v, e in zip(found, expected, strict=True))

    for position, divide in enumerate(graph.node):
        multiply = makers.get(divide.input[0]) if divide.op_type == "Div" and constant(divide, 6.0) else None
        if multiply is None or multiply.op_type != "Mul":
            continue
        clip = makers.get(multiply.input[1])
        if clip is None or clip.op_type != "Clip" or not constant(clip, 0.0, 6.0):
            continue
        add = makers[clip.input[0]]
        if add.op_type == "Add" and add.input[0] == multiply.input[0] and constant(add, 3.0):
            graph.node[position].CopyFrom(helper.make_node("HardSwish", [add.input[0]], [divide.output[0]]))


def _convolution_before(name: str, makers: dict[str, NodeProto]) -> NodeProto:
    node = makers[name]
    while node.op_type != "Conv":
        node = makers[node.input[0]]
    return node
