"""The same backbone in another runtime's own loop (OpenCV, the network, numpy, OpenCV), and ours against it.

None of our code is in their loop. Both run in turn over the same frames.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.benchmarks.bench import OpenDrive, drive_chunks, in_turn
from edgemap.runtime.frames.errors import MissingExtraError
from edgemap.runtime.frames.extras import install_hint
from edgemap.runtime.frames.reading import library_path
from edgemap.runtime.network.engines import openvino_core
from edgemap.runtime.network.manifest import DetectorSpec

Infer = Callable[[NDArray[np.float32]], Sequence[NDArray[np.float32]]]
PAD, NMS_IOU = 114, 0.45


def openvino_network(path: Path, detector: DetectorSpec, threads: int) -> tuple[Infer, str]:
    """The backbone compiled by OpenVINO with the LATENCY hint: the better of float32 and its default precision.

    Raises MissingExtraError without the extra `openvino`.
    """
    try:
        core = openvino_core()
    except ImportError:
        raise MissingExtraError(f"--against openvino needs OpenVINO: {install_hint('openvino')}") from None
    model = core.read_model(library_path(path))
    names = [output.get_any_name() for output in model.outputs]
    heads = [names.index(head.name) for head in detector.heads]
    probe = np.random.default_rng(0).uniform(0, 255, (1, 3, detector.input.height, detector.input.width))
    candidates: dict[str, Infer] = {}
    for precision, extra in (("f32", {"INFERENCE_PRECISION_HINT": "f32"}), ("default", {})):
        config = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_NUM_THREADS": threads} | extra
        request = core.compile_model(model, "CPU", config).create_infer_request()

        def infer(tensor: NDArray[np.float32], request=request) -> Sequence[NDArray[np.float32]]:  # noqa: ANN001
            request.infer([tensor], share_inputs=True)
            return [request.get_output_tensor(index).data for index in heads]

        candidates[precision] = infer
    calls = {precision: partial(infer, probe.astype(np.float32)) for precision, infer in candidates.items()}
    found = in_turn(repeat(calls, 15))
    best = min(found, key=lambda precision: found[precision][0])
    return candidates[best], best


def opencv_network(path: Path, detector: DetectorSpec, threads: int) -> tuple[Infer, str]:
    """The backbone run by cv2.dnn on the CPU, float32."""
    cv2.setNumThreads(threads)
    network = cv2.dnn.readNetFromONNX(library_path(path))
    names = [head.name for head in detector.heads]

    def infer(tensor: NDArray[np.float32]) -> Sequence[NDArray[np.float32]]:
        network.setInput(tensor, detector.input.name)
        return list(network.forward(names))  # type: ignore[arg-type]

    return infer, "f32"


def picture_to_boxes(detector: DetectorSpec, infer: Infer, confidence: float) -> Callable[[NDArray[np.uint8]], object]:
    """Their loop as their demos write it: resize, network, boxes of all cells, suppression.

    Gives boxes xywh in picture px, scores and class ids.
    """
    spec = detector.input
    decode = {"yolov3": _yolov3, "yolox": _yolox, "dfl": _picodet}[detector.decode]
    centred, stretched = spec.resize == "letterbox", spec.resize == "stretch"
    mean, factor = np.array(spec.mean, np.float32), np.float32(spec.scale) / np.array(spec.std, np.float32)

    def run(image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        sides = np.array([spec.width / image.shape[1], spec.height / image.shape[0]], np.float32)
        scale = sides if stretched else np.full(2, sides.min())
        size = int(image.shape[1] * scale[0]), int(image.shape[0] * scale[1])
        canvas = np.full((spec.height, spec.width, 3), PAD, np.uint8)
        left, top = (spec.width - size[0]) // 2 * centred, (spec.height - size[1]) // 2 * centred
        canvas[top : top + size[1], left : left + size[0]] = cv2.resize(image, size)
        if spec.colour == "rgb":
            canvas = canvas[..., ::-1]
        tensor = canvas.transpose(2, 0, 1)[None].astype(np.float32)
        if spec.scale != 1.0 or any(spec.mean) or set(spec.std) != {1.0}:
            tensor = (tensor - mean[:, None, None] / np.float32(spec.scale)) * factor[:, None, None]
        boxes, scores, classes = decode(infer(np.ascontiguousarray(tensor, np.float32)), detector, confidence)
        boxes[:, :2] -= boxes[:, 2:] / 2 + np.array([left, top], np.float32)
        boxes /= np.tile(scale, 2)
        kept = np.asarray(cv2.dnn.NMSBoxes(boxes.tolist(), scores.tolist(), confidence, NMS_IOU), np.int64).reshape(-1)
        return boxes[kept], scores[kept], classes[kept]

    return run


def _yolov3(outputs: Sequence[NDArray[np.float32]], detector: DetectorSpec, confidence: float) -> tuple:
    parts = []
    for output, head in zip(outputs, detector.heads, strict=True):
        count, (rows, columns) = len(head.anchors), output.shape[2:]
        grid = output.reshape(count, -1, rows, columns).transpose(0, 2, 3, 1)
        objectness = _sigmoid(grid[..., 4])
        a, v, u = np.nonzero(objectness > confidence)
        cells = grid[a, v, u]
        xy = (_sigmoid(cells[:, :2]) * head.scale_xy - (head.scale_xy - 1) / 2 + np.stack([u, v], 1)) * head.strides[0]
        wh = np.exp(cells[:, 2:4]) * np.array(head.anchors, np.float32)[a]
        parts.append((np.concatenate([xy, wh], 1), objectness[a, v, u, None] * _sigmoid(cells[:, 5:])))
    return _strong(parts, confidence)


def _yolox(outputs: Sequence[NDArray[np.float32]], detector: DetectorSpec, confidence: float) -> tuple:
    rows, spec = outputs[0][0], detector.input
    grids, strides = [], []
    for stride in detector.heads[0].strides:
        u, v = np.meshgrid(np.arange(spec.width // stride), np.arange(spec.height // stride))
        grids.append(np.stack([u, v], 2).reshape(-1, 2))
        strides.append(np.full((u.size, 1), stride))
    grid, stride = np.concatenate(grids), np.concatenate(strides)
    boxes = np.concatenate([(rows[:, :2] + grid) * stride, np.exp(rows[:, 2:4]) * stride], 1)
    return _strong([(boxes, rows[:, 4:5] * rows[:, 5:])], confidence)


def _picodet(outputs: Sequence[NDArray[np.float32]], detector: DetectorSpec, confidence: float) -> tuple:
    labels, parts = len(detector.classes), []
    for output, head in zip(outputs, detector.heads, strict=True):
        rows, columns = output.shape[2:]
        cells = output[0].reshape(output.shape[1], -1).T
        bins = np.exp(cells[:, labels:].reshape(len(cells), 4, -1))
        sides = (bins / bins.sum(2, keepdims=True)) @ np.arange(bins.shape[2], dtype=np.float32)
        u, v = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        low = np.stack([u.ravel(), v.ravel()], 1) - sides[:, :2]
        size = sides[:, :2] + sides[:, 2:]
        parts.append((np.concatenate([low + size / 2, size], 1) * head.strides[0], _sigmoid(cells[:, :labels])))
    return _strong(parts, confidence)


def _strong(parts: list[tuple[NDArray, NDArray]], confidence: float) -> tuple:
    """Boxes, scores and class ids of the cells whose best score suffices. parts: boxes (N, 4), scores (N, classes)."""
    boxes, scores = (np.concatenate(column) for column in zip(*parts, strict=True))
    classes = scores.argmax(1)
    best = scores[np.arange(len(scores)), classes]
    keep = best >= confidence
    return boxes[keep].astype(np.float32), best[keep].astype(np.float32), classes[keep]


def _sigmoid(x: NDArray) -> NDArray:
    return 1 / (1 + np.exp(-x))


REST_S = 0.02  # after each call
MINIMUM_ROUNDS = 5

Boxes = Callable[[NDArray[np.uint8]], object]


def compare(
    boxes: tuple[Boxes, Boxes], networks: tuple[Callable[[], object], ...], open_drive: OpenDrive, seconds: float
) -> dict[str, float]:
    """Ratios of medians, ours / theirs, and the medians: latency, ms, and processor time, cpu_ms.

    boxes: from a picture, ours and theirs. networks: alone, ours and theirs. full_ratio: our whole step, with odometry
    and map, against their picture to boxes.
    """

    def rounds() -> Iterator[dict[str, Callable[[], object]]]:
        """All on one frame after another."""
        start = time.perf_counter()
        steps = ((slam, frame) for slam, frames in drive_chunks(open_drive) for frame in frames)
        for number, (slam, frame) in enumerate(steps, start=1):
            ours, theirs = (partial(find, frame.image) for find in boxes)
            yield dict(zip(names, (ours, theirs, partial(slam.step, frame), *networks), strict=True))
            if time.perf_counter() - start >= seconds and number >= MINIMUM_ROUNDS:
                return

    names = ("ours_end_to_end", "theirs_end_to_end", "ours_full", "ours_network", "theirs_network")
    found = in_turn(rounds(), REST_S)
    ms, cpu_ms = ({name: found[name][kind] for name in names} for kind in (0, 1))
    return {
        "network_ratio": round(ms["ours_network"] / ms["theirs_network"], 3),
        "end_to_end_ratio": round(ms["ours_end_to_end"] / ms["theirs_end_to_end"], 3),
        "full_ratio": round(ms["ours_full"] / ms["theirs_end_to_end"], 3),
        "cpu_ratio": round(cpu_ms["ours_end_to_end"] / max(cpu_ms["theirs_end_to_end"], 1e-9), 3),
        **{f"{name}_ms": round(value, 3) for name, value in ms.items()},
        **{f"{name}_cpu_ms": round(value, 3) for name, value in cpu_ms.items()},
    }
