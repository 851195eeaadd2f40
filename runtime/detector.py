"""Boxes in single pictures: preprocess, backbone, decode."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.decode import Decoder
from edgemap.runtime.network import Tensors
from edgemap.runtime.preprocess import Placement, Preprocessor


class Detector:
    """A bundle's detector without odometry or map, for pictures of any size, or of the one that it was fitted to."""

    def __init__(self, bundle: Bundle, decode: Decoder | None = None) -> None:
        self._backbone = bundle.backbone
        self._input_name = bundle.manifest.detector.input.name
        self._preprocess = Preprocessor(bundle.detector.input)
        self._decode = decode or Decoder(bundle.detector)

    def __call__(self, image: NDArray[np.uint8]) -> Detections:
        """Detections in a BGR uint8 picture (H, W, 3), best first."""
        return self._decode(*self.raw(image))

    def raw(self, image: NDArray[np.uint8]) -> tuple[Tensors, Placement]:
        """The backbone's outputs, for any decoder."""
        tensor, placement = self._preprocess(image)
        return self._backbone.run({self._input_name: tensor}), placement
