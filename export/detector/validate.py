"""Validation on labelled pictures during training: the runtime's decoding, COCO's AP."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.detector.network import TorchNetwork
from edgemap.export.detector.store import Example
from edgemap.runtime.network.decode import Decoder
from edgemap.runtime.network.preprocess import Preprocessor

BATCH = 16
CONFIDENCE, NMS_IOU = 0.005, 0.6


@torch.no_grad()
def validate(network: TorchNetwork, examples: Sequence[Example]) -> dict[str, Any]:
    """`average_precision` of a network over examples, of the classes that their labels name."""
    detector, device = network.detector, next(network.parameters()).device
    prepare, decode = Preprocessor(detector.input), Decoder(detector, CONFIDENCE, NMS_IOU)
    scored = []
    for start in range(0, len(examples), BATCH):
        chunk = examples[start : start + BATCH]
        prepared = [(tensor.copy(), placement) for tensor, placement in (prepare(example.image) for example in chunk)]
        pictures = torch.from_numpy(np.concatenate([tensor for tensor, _ in prepared])).to(device)
        outputs = dict(zip(network.graph.outputs, (x.cpu().numpy() for x in network.graph(pictures)), strict=True))
        for row, (example, (_, placement)) in enumerate(zip(chunk, prepared, strict=True)):
            height, width = example.image.shape[:2]
            found = decode({name: value[row : row + 1] for name, value in outputs.items()}, placement)
            complete = example.complete[found.class_ids]
            scored.append(
                ScoredPicture(
                    width,
                    height,
                    example.boxes.astype(np.float64),
                    example.labels,
                    found.boxes[complete],
                    found.class_ids[complete],
                    found.scores[complete],
                    example.unasked,
                )
            )
    return average_precision(scored, network.names)
