"""Comparison of int8 with float32: differences, AP50 where there is truth, time."""

import time
from typing import Any

import numpy as np

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.calibration import Calibration
from edgemap.export.detector.validate import CONFIDENCE, NMS_IOU
from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.compute import processor_name, time_ratio
from edgemap.runtime.network.decode import Decoder
from edgemap.runtime.network.preprocess import Preprocessor

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
