"""Inputs of a floor head: the frozen detector's features of strides 4 to 32."""

import hashlib
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from edgemap.export.adopt import Tensor4, only_outputs
from edgemap.export.detector.network import load_detector
from edgemap.export.floor.head import STRIDES
from edgemap.export.floor.merge import floor_taps
from edgemap.export.onnx_export import free_rows
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.preprocess import Placement, Preprocessor, rows_of

Float = NDArray[np.float32]


class Features:
    """Pictures to a detector's features, in onnxruntime. backbone: a bundle, by name or folder, or a best.pt.

    key: a hash of everything that they depend on. open: whether the bundle leaves off the rows of the input that a
    picture does not reach; then they are not computed here either.
    """

    def __init__(self, backbone: str, threads: int = 1) -> None:
        model, manifest = load_detector(backbone)
        detector = manifest.detector
        self.backbone, self.taps = manifest.name, floor_taps(model, detector)
        self.open = free_rows(model, detector.input) is not model
        self._preprocess, self._input = Preprocessor(detector.input), detector.input
        tapped = only_outputs(model, self.taps)
        graph = (free_rows(tapped, detector.input) if self.open else tapped).SerializeToString()
        self._network = cache(partial(open_network, graph, Compute(threads)))  # by rows of the input
        described = model.SerializeToString(deterministic=True) + repr((detector.input, self.taps, self.open)).encode()
        self.key = hashlib.sha256(described).hexdigest()

    def __call__(self, image: NDArray[np.uint8]) -> tuple[list[Float], Placement, Float]:
        """Four maps (1, C, H, W), finest first, 0 where not computed; where the picture lies in the input; and which of
        the coarsest rows are computed, (1, H32) of 0 and 1.
        """
        tensor, placement = self._preprocess(image)
        height, whole = self._input.height, (0, self._input.height)
        first, rows = rows_of(self._input, image.shape[1], image.shape[0], STRIDES[-1]) if self.open else whole
        found = self._network(rows).run({self._input.name: tensor[:, :, first : first + rows]})
        maps = [_filled(found[tap.name], tap, first / height) for tap in self.taps]
        computed = np.zeros((1, self.taps[-1].height), np.float32)
        computed[:, first // STRIDES[-1] : (first + rows) // STRIDES[-1]] = 1.0
        return maps, placement, computed


def _filled(part: Float, tap: Tensor4, above: float) -> Float:
    first = round(above * tap.height)
    return np.pad(part, ((0, 0), (0, 0), (first, tap.height - first - part.shape[2]), (0, 0)))
