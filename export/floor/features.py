"""Inputs of a floor head: the frozen detector's features of strides 4 to 32."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Sequence

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import ModelProto

from edgemap.export.adopt import Tensor4
from edgemap.export.detector.checkpoint import load_detector
from edgemap.export.floor.merge import floor_taps
from edgemap.runtime.network.engines import open_onnxruntime
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.network.preprocess import Placement, Preprocessor


class Features:
    """Pictures to a detector's features, in onnxruntime. backbone: a bundle, by name or folder, or a best.pt.

    key: a hash of everything that they depend on.
    """

    def __init__(self, backbone: str, threads: int = 1) -> None:
        model, manifest = load_detector(backbone)
        detector = manifest.detector
        self.backbone, self.taps = manifest.name, floor_taps(model, detector)
        self._preprocess, self._input = Preprocessor(detector.input), detector.input.name
        self._network = tapped_network(model, self.taps, threads)
        described = model.SerializeToString(deterministic=True) + repr((detector.input, self.taps)).encode()
        self.key = hashlib.sha256(described).hexdigest()

    def __call__(self, image: NDArray[np.uint8]) -> tuple[list[NDArray[np.float32]], Placement]:
        """Four maps (1, C, H, W), finest first, and where the picture lies in the input."""
        tensor, placement = self._preprocess(image)
        found = self._network.run({self._input: tensor})
        return [found[tap.name] for tap in self.taps], placement


def tapped_network(model: ModelProto, taps: Sequence[Tensor4], threads: int = 1) -> Network:
    """A network that returns these tensors of a model, in this order."""
    model = copy.deepcopy(model)
    del model.graph.output[:]
    for tap in taps:
        shape = (1, tap.channels, tap.height, tap.width)
        model.graph.output.append(onnx.helper.make_tensor_value_info(tap.name, onnx.TensorProto.FLOAT, shape))
    return open_onnxruntime(model.SerializeToString(), Compute(threads))
