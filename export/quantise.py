"""Static int8 variant of the backbone, by onnxruntime's quantiser: its pictures, its numbers, how it compares."""

import copy
import logging
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
from onnx import ModelProto, NodeProto, version_converter
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.detector.validate import CONFIDENCE, NMS_IOU
from edgemap.export.onnx_export import IR_VERSION, default_opset, save_model, seal
from edgemap.runtime.inputs.drives.drive import LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures, read_picture
from edgemap.runtime.inputs.drives.yolo import read_yolo
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.compute import processor_name, time_ratio
from edgemap.runtime.network.decode import Decoder
from edgemap.runtime.network.manifest import BundleVariant, DetectorSpec
from edgemap.runtime.network.manifest_file import read_manifest, sha256_file, verified_file, write_manifest
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import Preprocessor

MAXIMUM_SHOWN, MAXIMUM_JUDGED = 64, 200  # AP50 changes by 0.002 with another 64; 200 judge a loss of 0.01


@dataclass(frozen=True)
class Calibration:
    """shown: pictures that determine the ranges. judged: other ones for evaluation (a single picture serves both), with
    truth where available.
    """

    folder: Path
    shown: tuple[Path, ...]
    judged: tuple[tuple[Path, LabelledBoxes | None], ...]


def read_calibration(folder: Path) -> Calibration:
    """Pictures of a folder, spread evenly over it; a yolo data folder brings truth along. Raises CameraError."""
    if (folder / "labels").is_dir() or (folder / "boxes.json").is_file():
        drive = read_yolo(folder)
        pictures = list(zip(drive.images, drive.boxes, strict=True))
    else:
        pictures = [(path, None) for path in list_pictures(first_folder(folder, ("images",)))]
    shown = _evenly(len(pictures), min(MAXIMUM_SHOWN, (len(pictures) + 1) // 2))
    others = [index for index in range(len(pictures)) if index not in set(shown)] or shown
    judged = [others[index] for index in _evenly(len(others), MAXIMUM_JUDGED)]
    return Calibration(folder, tuple(pictures[i][0] for i in shown), tuple(pictures[i] for i in judged))


def _evenly(count: int, wanted: int) -> list[int]:
    return np.linspace(0, count - 1, min(count, wanted)).astype(int).tolist()


TIMED = 30  # runs of each


def int8_report(exact: Bundle, small: Bundle, calibration: Calibration) -> dict[str, Any]:
    """Figures for the manifest, both networks on the judged pictures.

    difference: by output, the largest and the mean absolute one, beside the output's own mean absolute value. ap50: of
    both, where any picture shows a class of the bundle. time: int8 / float32, processor time on one thread, in turn.
    """
    spec = exact.manifest.detector
    preprocess, decode = Preprocessor(spec.input), Decoder(spec, CONFIDENCE, NMS_IOU)
    numbers = {name: index for index, name in enumerate(exact.names)}
    scored: dict[str, list[ScoredPicture]] = {"float32": [], "int8": []}
    differences: dict[str, list[tuple[float, float, float]]] = {name: [] for name in exact.backbone.outputs}
    tensors = {}
    for path, truth in calibration.judged:
        image = read_picture(path)
        tensor, placement = preprocess(image)
        tensors = {spec.input.name: tensor}
        outputs = {"float32": exact.backbone.run(tensors), "int8": small.backbone.run(tensors)}
        for name, values in differences.items():
            true = outputs["float32"][name].astype(np.float64)
            gap = np.abs(outputs["int8"][name] - true)
            values.append((gap.max(), gap.mean(), np.abs(true).mean()))
        if truth is not None:
            size, ignored = (image.shape[1], image.shape[0]), truth.ignorable()
            for precision, pictures in scored.items():
                found = decode(outputs[precision], placement)
                pictures.append(ScoredPicture.compare(size, truth.boxes, truth.labels, ignored, found, numbers))
    report: dict[str, Any] = {
        "data": calibration.folder.name,
        "pictures_shown": len(calibration.shown),
        "pictures_judged": len(calibration.judged),
        "difference": {name: _summary(np.array(values)) for name, values in differences.items()},
        "time": round(_time(exact, small, tensors), 3),
        "processor": processor_name(),
    }
    if any(len(picture.true_labels) and not np.all(picture.ignored) for picture in scored["int8"]):
        report["ap50"] = {
            precision: average_precision(pictures, exact.names)["ap50"] for precision, pictures in scored.items()
        }
    return report


def _summary(values: np.ndarray) -> dict[str, float]:
    worst, mean, size = values[:, 0].max(), values[:, 1].mean(), values[:, 2].mean()
    return {"largest": float(f"{worst:.4g}"), "mean": float(f"{mean:.4g}"), "mean_value": float(f"{size:.4g}")}


def _time(exact: Bundle, small: Bundle, tensors: dict[str, Any]) -> float:
    runs = (lambda: small.backbone.run(tensors)), (lambda: exact.backbone.run(tensors))
    return time_ratio(*runs, clock=time.process_time, rest_s=0.0, rounds=TIMED)


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
