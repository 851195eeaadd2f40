"""The same backbone run by others, as their own demos do it: resize, network, numpy decode, OpenCV's suppression."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.bundle import Bundle
from edgemap.runtime.decode import Decoder
from edgemap.runtime.errors import MissingExtraError
from edgemap.runtime.manifest import Detector
from edgemap.runtime.network import Tensors
from edgemap.runtime.preprocess import Preprocessor

Infer = Callable[[NDArray[np.float32]], Tensors]


def openvino_network(bundle: Bundle, threads: int) -> tuple[Infer, str]:
    """The backbone compiled by OpenVINO with the LATENCY hint: the better of float32 and its default precision.

    Raises MissingExtraError without the extra `openvino`.
    """
    try:
        import openvino as ov
    except ImportError:
        raise MissingExtraError("--against openvino needs OpenVINO: pip install 'edgemap[openvino]'") from None
    core = ov.Core()
    model = core.read_model(bundle.folder / bundle.manifest.detector.file)
    shape = [1, 3, bundle.manifest.detector.input.height, bundle.manifest.detector.input.width]
    probe = np.random.default_rng(0).uniform(0, 255, shape).astype(np.float32)
    candidates = []
    for precision, extra in (("f32", {"INFERENCE_PRECISION_HINT": "f32"}), ("default", {})):
        config = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_NUM_THREADS": threads} | extra
        request = core.compile_model(model, "CPU", config).create_infer_request()
        names = [output.get_any_name() for output in model.outputs]

        def infer(tensor: NDArray[np.float32], request=request, names=names) -> Tensors:  # noqa: ANN001
            request.infer([tensor], share_inputs=True)
            return {name: request.get_output_tensor(i).data for i, name in enumerate(names)}

        candidates.append((_median_ms(infer, probe), precision, infer))
    _, precision, best = min(candidates, key=lambda candidate: candidate[0])
    return best, precision


def opencv_network(bundle: Bundle, threads: int) -> tuple[Infer, str]:
    """The backbone run by cv2.dnn on the CPU, float32."""
    cv2.setNumThreads(threads)
    network = cv2.dnn.readNetFromONNX(str(bundle.folder / bundle.manifest.detector.file))
    names = list(bundle.backbone.outputs)

    def infer(tensor: NDArray[np.float32]) -> Tensors:
        network.setInput(tensor, bundle.manifest.detector.input.name)
        outputs: list = list(network.forward(names))
        return dict(zip(names, outputs, strict=True))

    return infer, "f32"


def picture_to_boxes(detector: Detector, infer: Infer, confidence: float) -> Callable[[NDArray[np.uint8]], object]:
    """Their whole way: the same resize and decode as ours, so that only the network's runtime differs."""
    preprocess, decode = Preprocessor(detector.input), Decoder(detector, confidence)

    def run(image: NDArray[np.uint8]) -> object:
        tensor, placement = preprocess(image)
        return decode(infer(tensor), placement)

    return run


def _median_ms(infer: Infer, probe: NDArray[np.float32]) -> float:
    laps = []
    for _ in range(15):
        before = perf_counter()
        infer(probe)
        laps.append(perf_counter() - before)
    return float(np.median(laps[3:]) * 1e3)
