"""Static int8 quantisation of the backbone with onnxruntime: calibration pictures, quantisation, and evaluation."""

import copy
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
from onnx import ModelProto, NodeProto, version_converter
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.detector.store import evenly
from edgemap.export.detector.validate import CONFIDENCE, NMS_IOU
from edgemap.export.onnx_export import IR_VERSION, default_opset, quiet, save_model, seal
from edgemap.runtime.inputs.drives.drive import LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures, read_picture
from edgemap.runtime.inputs.drives.yolo import read_yolo
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.decode import Decoder
from edgemap.runtime.network.engines import processor_name
from edgemap.runtime.network.manifest import BundleVariant, DetectorSpec, Manifest
from edgemap.runtime.network.manifest_file import sha256_file, verified_file, write_manifest
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import Preprocessor

MAXIMUM_SHOWN, MAXIMUM_JUDGED = 64, 200  # another 64 change AP50 by 0.002; 200 resolve a loss of 0.01


@dataclass(frozen=True)
class CalibrationPictures:
    """Pictures for quantisation. shown: determine the ranges. judged: other pictures for evaluation, with ground truth
    if available. A single picture serves both.
    """

    folder: Path
    shown: tuple[Path, ...]
    judged: tuple[tuple[Path, LabelledBoxes | None], ...]


def read_calibration(folder: Path) -> CalibrationPictures:
    """Selects pictures evenly from a folder. A YOLO data folder also has ground truth. Raises CameraError."""
    if (folder / "labels").is_dir() or (folder / "boxes.json").is_file():
        drive = read_yolo(folder)
        pictures = list(zip(drive.images, drive.boxes, strict=True))
    else:
        pictures = [(path, None) for path in list_pictures(first_folder(folder, ("images",)))]
    shown = evenly(len(pictures), min(MAXIMUM_SHOWN, (len(pictures) + 1) // 2))
    others = [index for index in range(len(pictures)) if index not in set(shown)] or shown
    judged = [others[index] for index in evenly(len(others), MAXIMUM_JUDGED)]
    return CalibrationPictures(folder, tuple(pictures[i][0] for i in shown), tuple(pictures[i] for i in judged))


WARM_UP, TIMED = 2, 30  # runs of each network


def int8_report(exact: Bundle, small: Bundle, calibration: CalibrationPictures) -> dict[str, Any]:
    """Compares both networks on the judged pictures, for the manifest.

    difference: largest and mean absolute difference of each output, and the mean absolute value of the output. ap50: of
    both networks, if any picture shows a class of the bundle. time: int8 / float32, processor time on one thread,
    measured alternately.
    """
    spec = exact.manifest.detector
    preprocess, decode = Preprocessor(spec.input), Decoder(spec, CONFIDENCE, NMS_IOU)
    numbers = {name: index for index, name in enumerate(exact.names)}
    scored: dict[str, list[ScoredPicture]] = {"float32": [], "int8": []}
    differences: dict[str, list[tuple[float, float, float]]] = {name: [] for name in exact.backbone.outputs}
    tensors = {}
    for path, truth in calibration.judged:
        tensor, placement = preprocess(read_picture(path))
        tensors = {spec.input.name: tensor}
        outputs = {"float32": exact.backbone.run(tensors), "int8": small.backbone.run(tensors)}
        for name, values in differences.items():
            true = outputs["float32"][name].astype(np.float64)
            gap = np.abs(outputs["int8"][name] - true)
            values.append((gap.max(), gap.mean(), np.abs(true).mean()))
        if truth is not None:
            ignored = truth.ignorable()
            for precision, pictures in scored.items():
                found = decode(outputs[precision], placement)
                pictures.append(ScoredPicture.compare(truth.boxes, truth.labels, ignored, found, numbers))
    report: dict[str, Any] = {
        "data": calibration.folder.name,
        "pictures_shown": len(calibration.shown),
        "pictures_judged": len(calibration.judged),
        "difference": {name: _summary(np.array(values)) for name, values in differences.items()},
        "time": round(_time(exact, small, tensors), 3),
        "processor": processor_name(),
    }
    if any(picture.scored.any() for picture in scored["int8"]):
        report["ap50"] = {
            precision: average_precision(pictures, exact.names)["ap50"] for precision, pictures in scored.items()
        }
    return report


def _summary(values: np.ndarray) -> dict[str, float]:
    worst, mean, size = values[:, 0].max(), values[:, 1].mean(), values[:, 2].mean()
    return {"largest": float(f"{worst:.4g}"), "mean": float(f"{mean:.4g}"), "mean_value": float(f"{size:.4g}")}


def _time(exact: Bundle, small: Bundle, tensors: dict[str, Any]) -> float:
    """Median processor time of int8 over float32's, run in turn."""
    rounds_s: list[tuple[float, ...]] = []
    for _ in range(WARM_UP + TIMED):
        stamps_s = [time.process_time()]
        for network in (small.backbone, exact.backbone):
            network.run(tensors)
            stamps_s.append(time.process_time())
        rounds_s.append(tuple(np.diff(stamps_s)))
    small_s, exact_s = np.median(rounds_s[WARM_UP:], axis=0)
    return float(small_s / exact_s)


FILE = "backbone.int8.onnx"
MINIMUM_OPSET = 13  # scales per channel


def add_int8(folder: Path, manifest: Manifest, calibration: CalibrationPictures) -> None:
    """Writes the int8 variant to the folder of a bundle, and its accuracy and speed to the manifest. Raises
    ExportError, BundleError or CameraError.
    """
    detector = manifest.detector
    source = onnx.load(verified_file(folder, manifest, detector.file))
    model = quantised(source, detector, calibration.shown)
    save_model(seal(model, msgspec.structs.replace(detector, file=FILE)), folder / FILE)
    manifest.sha256[FILE] = sha256_file(folder / FILE)
    variant = manifest.variants["int8"] = BundleVariant(file=FILE)
    write_manifest(folder, manifest)
    variant.measured = int8_report(load_bundle(folder), load_bundle(folder, precision="int8"), calibration)


def quantised(source: ModelProto, detector: DetectorSpec, pictures: Iterable[Path]) -> ModelProto:
    """Quantises the convolutions of a model to 8 bits: symmetric weights per channel, unsigned activations.

    The range of an activation is the mean of its minimum and of its maximum over the pictures. Weights have 8 bits.
    Processors without VNNI add pairs of products in 16 bits, so their results differ (`runtime.precision`).
    """
    model = copy.deepcopy(source)  # the quantiser empties its input
    if default_opset(model) < MINIMUM_OPSET:
        model = version_converter.convert_version(model, MINIMUM_OPSET)
    for number, node in enumerate(model.graph.node):
        node.name = node.name or f"node_{number}"
    heads = _last(detector)
    features = [value for value in model.graph.output if value.name not in heads]
    for value in features:  # outputs that feed 8-bit layers would be rounded; inner tensors are not
        model.graph.output.remove(value)
    with quiet(), tempfile.TemporaryDirectory() as name:  # it recommends a preprocessing that was already done
        path = Path(name) / FILE
        quantize_static(
            model,
            path,
            _Reader(detector, pictures),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            nodes_to_exclude=float_nodes(model, detector),
            calibrate_method=CalibrationMethod.MinMax,
            extra_options={"CalibMovingAverage": True},
        )
        small = onnx.load(path)
    small.graph.output.extend(features)
    small.ir_version = IR_VERSION
    return small


def float_nodes(model: ModelProto, detector: DetectorSpec) -> list[str]:
    """Names of the nodes that stay float32: the first convolution, the last convolutions of the heads, and all nodes on
    the path to a feature.

    The first convolution reads the picture. The last ones produce logits and box sizes, which need more than 256
    levels. An odometry was trained on float features, and receives identical ones. This is impossible if a
    feature is itself a head, as in the paper.
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
    """Nodes that compute tensors, back to the input, or on each path to the nearest node of type `until`."""
    found: set[str] = set()
    todo = list(tensors)
    while todo:
        node = makers.get(todo.pop())
        if node is not None and node.name not in found:
            found.add(node.name)
            todo += [] if node.op_type == until else node.input
    return found


class _Reader(CalibrationDataReader):
    """Provides calibration pictures to onnxruntime, one by one."""

    def __init__(self, detector: DetectorSpec, pictures: Iterable[Path]) -> None:
        name, preprocess = detector.input.name, Preprocessor(detector.input)
        self._tensors = ({name: preprocess(read_picture(path))[0].copy()} for path in pictures)

    def get_next(self) -> Tensors | None:  # type: ignore[override]
        return next(self._tensors, None)
