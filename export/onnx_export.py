"""Torch networks as ONNX: one file each, with the contract in its metadata and a variable input height where
possible."""

import copy
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import ModelProto, numpy_helper
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from edgemap.export.darknet import Darknet
from edgemap.export.errors import ExportError
from edgemap.export.odometry.paper import LARGE, PaperHead, eight_bits
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network.engines import ROWS, open_network
from edgemap.runtime.network.manifest import METADATA_KEY, DetectorSpec, InputSpec, OdometryHead, contract_metadata
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.open_bundle import keep_outputs

OPSET = 18
OPSETS = range(11, 24)  # what onnxruntime 1.17 and newer run
IR_VERSION = 8  # the newest that onnxruntime 1.17 reads is 9; 8 goes with opset 18


def backbone_to_onnx(network: Darknet, detector: DetectorSpec) -> ModelProto:
    """A Darknet network for raw 0..255 pictures; batch normalisation and the factor 1/255 are folded into the weights.

    The outputs are named by the detector's heads and features in `network.outputs` order. `network` is not changed.
    """
    folded = copy.deepcopy(network).eval()
    for layer in folded.convolutions():
        if layer.norm is not None:
            layer.conv, layer.norm = fuse_conv_bn_eval(layer.conv.double(), layer.norm.double()).float(), None
    _fold_input_scale(folded, 1.0 / 255.0)
    example = torch.zeros(1, network.channels, network.height, network.width)
    return seal(to_onnx(folded, [example], [detector.input.name], list(detector.outputs())), detector)


def head_to_onnx(head: PaperHead, record: OdometryHead) -> ModelProto:
    """One step of a head. Inputs: feature and states; outputs: motion and states. Weights of 8 bits are stored as
    such."""
    inputs = [record.feature_input, *(state.input for state in record.states)]
    outputs = [record.motion, *(state.output for state in record.states)]
    example = [torch.zeros(shape) for shape in (head.shape, *(state.shape for state in record.states))]
    return seal(_in_bytes(to_onnx(head, example, inputs, outputs)), record)


def _in_bytes(model: ModelProto) -> ModelProto:
    graph, nodes = model.graph, []
    for item in graph.initializer:
        values = numpy_helper.to_array(item)
        if values.dtype != np.float32 or values.ndim < 2 or values.size < LARGE:
            continue
        whole, scale = eight_bits(torch.from_numpy(values.copy()))
        if np.allclose((whole * scale).numpy(), values, rtol=1e-5, atol=0.0):
            name, parts = item.name, [f"{item.name}_int8", f"{item.name}_scale"]
            item.CopyFrom(numpy_helper.from_array(whole.numpy().astype(np.int8), parts[0]))
            graph.initializer.append(numpy_helper.from_array(scale.numpy().ravel(), parts[1]))
            nodes.append(onnx.helper.make_node("DequantizeLinear", parts, [name], axis=0))
    for node in reversed(nodes):
        graph.node.insert(0, node)
    return model


def to_onnx(module: nn.Module, example: Sequence[Tensor], inputs: list[str], outputs: list[str]) -> ModelProto:
    """Trace a module at the example's shapes."""
    with quiet(), torch.no_grad():
        program = torch.onnx.export(
            module.eval(),
            tuple(example),
            input_names=inputs,
            output_names=outputs,
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model = program.model_proto
    model.ir_version = IR_VERSION
    _forget_tracing(model)
    _fuse_pool_padding(model)
    return model


@contextmanager
def quiet() -> Iterator[None]:
    """Without the warnings of exporters and quantisers, which are about their own insides."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    finally:
        logging.disable(before)


def seal(model: ModelProto, record: DetectorSpec | OdometryHead) -> ModelProto:
    """Write the contract into the model's metadata and check the model. Raises ExportError."""
    del model.metadata_props[:]
    model.metadata_props.add(key=METADATA_KEY, value=contract_metadata(record))
    try:
        onnx.checker.check_model(model, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        raise ExportError(f"{record.file}: not a valid ONNX model ({str(error).splitlines()[0][:160]})") from None
    if (opset := default_opset(model)) not in OPSETS:
        raise ExportError(f"{record.file}: ONNX opset {opset}, the runtime reads {OPSETS[0]} to {OPSETS[-1]}")
    return model


def save_model(model: ModelProto, path: Path) -> None:
    """Write one file without external data."""
    path.write_bytes(model.SerializeToString(deterministic=True))


def default_opset(model: ModelProto) -> int:
    """Version of the default operator set."""
    return next((item.version for item in model.opset_import if item.domain in ("", "ai.onnx")), 0)


def _fold_input_scale(network: Darknet, factor: float) -> None:
    """Zero padding stays zero under a factor, so scaling the first weights is the same as scaling the picture."""
    readers = [layer for layer in network.layers if -1 in layer.sources]  # type: ignore[operator]
    if len(readers) != 1 or readers[0].module is not network.convolutions()[0]:
        raise ExportError(f"{network.name}: its input must be read by one [convolutional] layer only")
    with torch.no_grad():
        weight = network.convolutions()[0].conv.weight
        weight.copy_(weight.double() * factor)


def _forget_tracing(model: ModelProto) -> None:
    """Drop the tracer's debug records: their stack traces name folders of the build machine."""
    model.doc_string = model.graph.doc_string = ""
    del model.graph.metadata_props[:]
    for node in model.graph.node:
        node.doc_string = ""
        del node.metadata_props[:]
    for value in (*model.graph.value_info, *model.graph.input, *model.graph.output, *model.graph.initializer):
        value.doc_string = ""
        del value.metadata_props[:]


def _fuse_pool_padding(model: ModelProto) -> None:
    """Pad with -inf then MaxPool is MaxPool with pads: one node less, and no infinities that disturb a quantiser."""
    graph = model.graph
    makers = {node.output[0]: node for node in graph.node}
    constants = {item.name: item for item in graph.initializer}
    for pool in [node for node in graph.node if node.op_type == "MaxPool"]:
        pad = makers.get(pool.input[0])
        if pad is None or pad.op_type != "Pad" or sum(pad.output[0] in node.input for node in graph.node) != 1:
            continue
        if len(pad.input) < 3 or numpy_helper.to_array(constants[pad.input[2]]) != float("-inf"):
            continue
        amounts = numpy_helper.to_array(constants[pad.input[1]]).tolist()
        attribute = next(item for item in pool.attribute if item.name == "pads")
        assert not any(attribute.ints)
        attribute.ints[:] = [amounts[2], amounts[3], amounts[6], amounts[7]]
        pool.input[0] = pad.input[0]
        graph.node.remove(pad)
    drop_unused(model)


def drop_unused(model: ModelProto) -> None:
    """Drops the nodes and constants that no output needs."""
    keep_outputs(model.graph, {value.name for value in model.graph.output})


def shape_of(value: onnx.ValueInfoProto) -> tuple[int, ...]:
    """Shape of an input, output or tensor of a graph; 0 for a size that it leaves open."""
    return tuple(axis.dim_value for axis in value.type.tensor_type.shape.dim)


def input_shapes(model: ModelProto) -> dict[str, tuple[int, ...]]:
    """Names and shapes of a graph's inputs; older files list the weights among them, which are none."""
    constants = {item.name for item in model.graph.initializer}
    return {value.name: shape_of(value) for value in model.graph.input if value.name not in constants}


def free_rows(model: ModelProto, spec: InputSpec) -> ModelProto:
    """The model with a variable input height, where pictures are letterboxed and all outputs are maps.

    Otherwise, or where the model has a fixed size inside (YOLOX's list of boxes), the model is returned unchanged.
    """
    height, shapes = spec.height, {value.name: shape_of(value) for value in model.graph.output}
    if spec.resize == "stretch" or any(len(shape) != 4 for shape in shapes.values()):
        return model
    freed = copy.deepcopy(model)
    del freed.graph.value_info[:]
    for value in (freed.graph.input[0], *freed.graph.output):
        rows = value.type.tensor_type.shape.dim[2]
        part = height // rows.dim_value
        rows.Clear()
        rows.dim_param = ROWS if part == 1 else f"{ROWS}/{part}"
    coarsest = max(height // shape[2] for shape in shapes.values())
    return freed if all(_fits(freed, rows, shapes, height) for rows in (height, height - coarsest)) else model


def _fits(model: ModelProto, rows: int, shapes: dict[str, tuple[int, ...]], height: int) -> bool:
    """Whether the outputs have the shapes of that many input rows. shapes: those of `height` rows."""
    try:
        onnx.checker.check_model(model, full_check=True)
        found = open_network(model.SerializeToString(), Compute(), rows).outputs
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError, BundleError):
        return False
    return found == {n: (*shape[:2], shape[2] * rows // height, shape[3]) for n, shape in shapes.items()}
