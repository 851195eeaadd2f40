"""Static int8 variant of the backbone: 8-bit weights and activations, by onnxruntime's quantiser."""

import copy
import logging
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
import onnx
from onnx import ModelProto, NodeProto, version_converter
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static

from edgemap.export.calibration import Calibration
from edgemap.export.int8_report import int8_report
from edgemap.export.onnx_export import IR_VERSION, default_opset, save_model, seal
from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest import (
    BundleVariant,
    DetectorSpec,
    read_manifest,
    sha256_file,
    verified_file,
    write_manifest,
)
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import Preprocessor

FILE = "backbone.int8.onnx"
MINIMUM_OPSET = 13  # scales per channel


def add_int8(folder: Path, calibration: Calibration) -> None:
    """Writes the int8 variant into a bundle's folder, and its accuracy and speed into bundle.json. Raises ExportError,
    BundleError or CameraError.
    """
    manifest = read_manifest(folder)
    detector = manifest.detector
    source = onnx.load(verified_file(folder, manifest, detector.file))
    model = quantised(source, detector, _tensors(detector, calibration.shown))
    save_model(seal(model, msgspec.structs.replace(detector, file=FILE)), folder / FILE)
    manifest.sha256[FILE] = sha256_file(folder / FILE)
    variant = manifest.variants["int8"] = BundleVariant(file=FILE)
    write_manifest(folder, manifest)
    variant.measured = int8_report(load_bundle(folder, 1), load_bundle(folder, 1, "int8"), calibration)
    write_manifest(folder, manifest)


def quantised(source: ModelProto, detector: DetectorSpec, tensors: Iterable[Tensors]) -> ModelProto:
    """The model with 8-bit convolutions: weights symmetric per channel, activations unsigned.

    An activation's range is the mean over the pictures of its least and largest value. Weights have 8 bits: processors
    without VNNI, which add pairs of products in 16 bits, compute something else (`runtime.precision`).
    """
    model = copy.deepcopy(source)  # the quantiser empties what it is given
    if default_opset(model) < MINIMUM_OPSET:
        model = version_converter.convert_version(model, MINIMUM_OPSET)
    for number, node in enumerate(model.graph.node):
        node.name = node.name or f"node_{number}"
    heads = _last(detector)
    features = [value for value in model.graph.output if value.name not in heads]
    for value in features:  # outputs that feed 8-bit layers would come out rounded; as inner tensors they do not
        model.graph.output.remove(value)
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)  # it recommends a preparation that our graphs have behind them
    try:
        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / FILE
            quantize_static(
                model,
                path,
                _Reader(tensors),
                quant_format=QuantFormat.QDQ,
                per_channel=True,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                nodes_to_exclude=float_nodes(model, detector),
                calibrate_method=CalibrationMethod.MinMax,
                extra_options={"CalibMovingAverage": True},
            )
            small = onnx.load(path)
    finally:
        logging.disable(before)
    small.graph.output.extend(features)
    small.ir_version = IR_VERSION
    return small


def float_nodes(model: ModelProto, detector: DetectorSpec) -> list[str]:
    """Names of the nodes that stay float32: the first convolution, the last ones of the heads, all that leads to a
    feature.

    The first one reads the picture, the others produce logits and box sizes, which need more than 256 levels. An
    odometry was trained on float features and gets identical ones; that is impossible for a feature that is itself a
    head (the paper's).
    """
    makers = {name: node for node in model.graph.node for name in node.output}
    heads = _last(detector)
    features = {feature.name for feature in detector.features} - heads
    first = {node.name for node in [node for node in model.graph.node if node.op_type == "Conv"][:1]}
    return sorted(first | _leading_to(heads, makers, until="Conv") | _leading_to(features, makers))


def _last(detector: DetectorSpec) -> set[str]:
    """Outputs whose last convolution stays float32: boxes and the floor mask."""
    return {head.name for head in detector.heads} | ({detector.floor.name} if detector.floor else set())


def _leading_to(tensors: set[str], makers: dict[str, NodeProto], until: str | None = None) -> set[str]:
    """Nodes that tensors come from, back to the input or to the first of a kind on every way."""
    found: set[str] = set()
    todo = list(tensors)
    while todo:
        node = makers.get(todo.pop())
        if node is not None and node.name not in found:
            found.add(node.name)
            todo += [] if node.op_type == until else node.input
    return found


def _tensors(detector: DetectorSpec, pictures: Iterable[Path]) -> Iterator[Tensors]:
    preprocess = Preprocessor(detector.input)
    for path in pictures:
        tensor, _ = preprocess(read_picture(path))
        yield {detector.input.name: tensor.copy()}


class _Reader(CalibrationDataReader):
    """Calibration tensors one by one, as onnxruntime asks for them."""

    def __init__(self, tensors: Iterable[Tensors]) -> None:
        self._tensors = iter(tensors)

    def get_next(self) -> Tensors | None:  # type: ignore[override]
        return next(self._tensors, None)
