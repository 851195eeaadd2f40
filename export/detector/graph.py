"""An ONNX network as a trainable torch module, operator by operator, and back to ONNX."""

import copy
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn import functional

from edgemap.export.errors import ExportError
from edgemap.export.onnx_export import input_shapes
from edgemap.runtime.frames.reading import error_line, one_line

Operator = Callable[..., Any]


class Graph(nn.Module):
    """The network of an ONNX file: pictures (B, C, H, W) as its input wants them, to its outputs in the file's order.

    Weights and biases of its convolutions are the parameters, under the file's names with ':' before them and for '.'.
    Accepts any batch size, and any picture size that is a multiple of 32. Raises ExportError for unsupported operators.
    """

    def __init__(self, model: ModelProto) -> None:
        super().__init__()
        self._model = _constants_as_initializers(model)
        graph = self._model.graph
        self._values = {item.name: _array(item) for item in graph.initializer}
        self.input = next(iter(input_shapes(self._model)), "")
        self.outputs = [value.name for value in graph.output]
        convolutions = [node for node in graph.node if node.op_type == "Conv"]
        for node in convolutions:
            if not set(node.input[1:]) <= self._values.keys():
                raise ExportError(f"convolution {one_line(node.output[0], 60)}: its weights are not stored in the file")
            for name in node.input[1:]:
                value = torch.from_numpy(self._values[name].astype(np.float32))
                self.register_parameter(_key(name), nn.Parameter(value))
        gates = _silu_gates(graph.node, self.outputs)
        self._plan: list[tuple[list[str], Operator, list[str]]] = [
            (list(node.output), functional.silu, [name for name in node.input if name not in gates])
            if gates & set(node.input)
            else (list(node.output), self._operator(node), self._read(node))
            for node in graph.node
            if node.output[0] not in gates
        ]
        last = {name: position for position, (_, _, names) in enumerate(self._plan) for name in names}
        self._over = [
            [name for name, at in last.items() if at == position and name not in self.outputs]
            for position in range(len(self._plan))
        ]

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """The outputs."""
        found: dict[str, Tensor] = {self.input: image}
        for (outputs, operator, names), over in zip(self._plan, self._over, strict=True):
            made = operator(*(found[name] if name in found else self._parameters[_key(name)] for name in names))
            found.update(zip(outputs, made if isinstance(made, tuple) else (made,), strict=True))
            for name in over:
                found.pop(name, None)
        return tuple(found[name] for name in self.outputs)

    def model(self) -> ModelProto:
        """The file again, with the weights of now."""
        model = copy.deepcopy(self._model)
        for item in model.graph.initializer:
            parameter = self._parameters.get(_key(item.name))
            if parameter is not None:
                value = parameter.detach().float().cpu().contiguous().numpy()
                item.CopyFrom(numpy_helper.from_array(value, item.name))
        return model

    def _read(self, node: NodeProto) -> list[str]:
        """The inputs that are computed or learnt; the others are part of the operator."""
        return [name for name in node.input if name and (name not in self._values or _key(name) in self._parameters)]

    def _operator(self, node: NodeProto) -> Operator:
        options = {item.name: helper.get_attribute_value(item) for item in node.attribute}
        constants = [self._values[name] for name in node.input if name in self._values]
        if node.op_type == "Conv":
            return _convolution(node, options)
        build = _OPERATORS.get(node.op_type)
        try:
            if build is not None and not (constants and node.op_type in _OF_TENSORS):
                return build(options, constants)
        except (KeyError, IndexError, ValueError):
            pass
        raise ExportError(f"operator {one_line(node.op_type, 40)} ({one_line(node.output[0], 60)}): cannot be trained")


def _silu_gates(nodes: Sequence[NodeProto], outputs: Sequence[str]) -> set[str]:
    """The sigmoids that nothing reads but the product with what they are of: x * sigmoid(x) is one operator here."""
    uses = Counter(name for node in nodes for name in node.input)
    of = {node.output[0]: node.input[0] for node in nodes if node.op_type == "Sigmoid"}
    pairs = [tuple(node.input) for node in nodes if node.op_type == "Mul"]
    found = {gate for a, b in pairs for gate, x in ((a, b), (b, a)) if of.get(gate) == x and uses[gate] == 1}
    return found - set(outputs)


def _convolution(node: NodeProto, options: dict[str, Any]) -> Operator:
    pads = options.get("pads", [0, 0, 0, 0])
    if pads[:2] != pads[2:]:
        raise ExportError(f"convolution {one_line(node.output[0], 60)}: uneven padding {pads}")
    stride, dilation, groups = options.get("strides", [1, 1]), options.get("dilations", [1, 1]), options.get("group", 1)

    def convolve(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
        if groups > 1 and x.device.type == "cpu":
            # In bfloat16 the gradients of depthwise convolutions take up to forty times as long there as in float32.
            with torch.autocast("cpu", enabled=False):
                return functional.conv2d(x.float(), weight, bias, stride, pads[:2], dilation, groups)
        return functional.conv2d(x, weight, bias, stride, pads[:2], dilation, groups)

    return convolve


def _reshape(_: dict[str, Any], constants: Sequence[np.ndarray]) -> Operator:
    """Channels into groups and back, or all cells in one row: any batch and size."""
    shape = [int(side) for side in constants[0]]
    if len(shape) == 3 and shape[2] == -1:
        return lambda x: x.flatten(2)
    if len(shape) not in (4, 5) or min(shape[1:-2]) < 1:
        raise ExportError(f"Reshape to {shape}: only channels into groups and back, or all cells in a row, is known")
    return lambda x: x.reshape([len(x), *shape[1:-2], *x.shape[-2:]])


def _resize(options: dict[str, Any], constants: Sequence[np.ndarray]) -> Operator:
    scales = constants[-1].tolist()
    if options.get("mode") != b"nearest" or scales != [1.0, 1.0, 2.0, 2.0]:
        raise ExportError(f"Resize by {scales}, {options.get('mode')}: only twice, nearest, is known")
    return lambda x: functional.interpolate(x, scale_factor=2.0, mode="nearest")


def _pool(options: dict[str, Any], _: Sequence[np.ndarray]) -> Operator:
    top, left, bottom, right = options.get("pads", [0, 0, 0, 0])
    size, stride = options["kernel_shape"], options["strides"]
    if (top, left) == (bottom, right):
        return lambda x: functional.max_pool2d(x, size, stride, (top, left))
    return lambda x: functional.max_pool2d(
        functional.pad(x, (left, right, top, bottom), value=-torch.inf), size, stride
    )


def _slice(_: dict[str, Any], constants: Sequence[np.ndarray]) -> Operator:
    starts, ends, axes, *steps = (value.tolist() for value in constants)
    index = [slice(None)] * (max(axes) + 1)
    for start, end, axis, step in zip(starts, ends, axes, steps[0] if steps else [1] * len(axes), strict=True):
        index[axis] = slice(start, end, step)
    return lambda x: x[tuple(index)]


_OPERATORS: dict[str, Callable[[dict[str, Any], Sequence[np.ndarray]], Operator]] = {
    "HardSwish": lambda _, __: functional.hardswish,
    "Relu": lambda _, __: functional.relu,
    "LeakyRelu": lambda o, _: lambda x: functional.leaky_relu(x, o.get("alpha", 0.01)),
    "Sigmoid": lambda _, __: lambda x: x.float().sigmoid(),  # of scores: near 1 bfloat16 has no steps left
    "HardSigmoid": lambda o, _: lambda x: (o.get("alpha", 0.2) * x + o.get("beta", 0.5)).clamp(0.0, 1.0),
    "Mul": lambda _, __: torch.mul,
    "Add": lambda _, __: torch.add,
    "Concat": lambda o, _: lambda *parts: torch.cat(parts, dim=o["axis"]),
    "Split": lambda o, c: lambda x: tuple(torch.split(x, c[0].tolist(), dim=o["axis"])),
    "Transpose": lambda o, _: lambda x: x.permute(*o["perm"]),
    "GlobalAveragePool": lambda _, __: lambda x: x.mean((2, 3), keepdim=True),
    "MaxPool": _pool,
    "Reshape": _reshape,
    "Resize": _resize,
    "Slice": _slice,
}
_OF_TENSORS = ("Mul", "Add", "Concat")  # what takes nothing that is stored in the file


def _constants_as_initializers(model: ModelProto) -> ModelProto:
    model = copy.deepcopy(model)
    graph = model.graph
    for node in list(graph.node):
        if node.op_type == "Constant" and node.attribute[0].name == "value":
            value = _array(helper.get_attribute_value(node.attribute[0]))
            graph.initializer.append(numpy_helper.from_array(value, node.output[0]))
            graph.node.remove(node)
    return model


def _array(tensor: TensorProto) -> np.ndarray:
    """Raises ExportError for a tensor of no type, or whose values do not fit its shape."""
    try:
        return numpy_helper.to_array(tensor)
    except (KeyError, ValueError, TypeError) as error:
        raise ExportError(
            f"tensor {one_line(tensor.name, 60)} does not read ({one_line(error_line(error), 100)})"
        ) from None


def _key(name: str) -> str:
    return ":" + name.replace(".", ":")
