"""A trained detector's checkpoint, ready to be bundled."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from edgemap.export.backbones import Backbone
from edgemap.export.detector.checkpoint import load_detector
from edgemap.export.detector.network import WithFeatures
from edgemap.export.detector.validate import nano_detector
from edgemap.export.errors import ExportError
from edgemap.export.onnx_export import to_onnx
from edgemap.runtime.manifest import sha256_file
from edgemap.runtime.network import Tensors

NAME = "edgemap-nano"
# The best maps of homes 8101-8106 and, with furniture unseen in training, 9110-9113, 9120-9122 and the demo.
CONFIDENCE, SURE_CONFIDENCE = 0.6, 0.75
FEATURES = {"head": 32, "stride32": 32, "stride8": 8, "stride4": 4}  # export's words for a feature, and its stride


def nano_backbone(path: Path, wanted: list[str]) -> Backbone:
    """The backbone of a best.pt. wanted: the features that heads read: head (the raw coarse map), stride8, stride4.

    Raises ExportError.
    """
    checkpoint = load_detector(path)
    if unknown := sorted(set(wanted) - set(FEATURES)):
        raise ExportError(f"{path}: has no feature {unknown[0]!r}; there are {', '.join(FEATURES)}")
    strides = list(dict.fromkeys(FEATURES[word] for word in wanted))
    detector = nano_detector(checkpoint.names, checkpoint.size, checkpoint.size, strides)
    extra = [stride for stride in strides if stride != 32]
    network = WithFeatures(copy.deepcopy(checkpoint.network), extra).eval()
    names = [*(head.name for head in detector.heads), *(f"feature_stride{stride}" for stride in extra)]
    example = torch.zeros(1, 3, checkpoint.size, checkpoint.size)

    def reference(picture: NDArray[np.float32]) -> Tensors:
        with torch.no_grad():
            return {
                name: tensor.numpy() for name, tensor in zip(names, network(torch.from_numpy(picture)), strict=True)
            }

    weights = {
        "file": path.name,
        "sha256": sha256_file(path),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
    }
    return Backbone(
        name=NAME,
        model=to_onnx(network, [example], [detector.input.name], names, detector),
        detector=detector,
        features={word: detector.features[strides.index(FEATURES[word])].name for word in wanted},
        reference=reference,
        exact=False,
        measured={"weights": weights, **checkpoint.measured},
        licence=checkpoint.licence,
        sources=(*checkpoint.sources, "fine-tuned on pictures rendered by edgemap simulate"),
        confidence=CONFIDENCE,
        sure_confidence=SURE_CONFIDENCE,
    )
