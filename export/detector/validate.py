"""How good a network is on labelled pictures, while it trains: the runtime's decoding, COCO's AP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.detector.augment import plain
from edgemap.export.detector.classes import nano_classes
from edgemap.export.detector.network import ANCHORS, EARLY_WIDTH, SCALE_XY, STRIDES, WIDTHS, Nano
from edgemap.export.detector.store import Example
from edgemap.runtime.decode import Decoder
from edgemap.runtime.manifest import Detector, FeatureSpec, HeadSpec, InputSpec
from edgemap.runtime.preprocess import place

BATCH = 16
CONFIDENCE, NMS_IOU = 0.005, 0.6


def nano_detector(names: Sequence[str], width: int, height: int, strides: Sequence[int] = ()) -> Detector:
    """The contract: BGR 0..255, letterboxed to the top left with grey 114; three raw heads; features of some strides.

    strides: 4 (32 channels of the first layers), 8 (64 channels) or 32 (the raw coarse head).
    """
    channels = 5 + len(names)
    heads = tuple(
        HeadSpec(
            name=f"head_stride{stride}",
            shape=(1, channels, height // stride, width // stride),
            strides=(stride,),
            anchors=(anchor,),
            scale_xy=SCALE_XY,
        )
        for stride, anchor in zip(STRIDES[::-1], ANCHORS[::-1], strict=True)
    )
    channels_of = {4: EARLY_WIDTH, 8: WIDTHS[0]}
    features = tuple(
        FeatureSpec(name=heads[0].name, shape=heads[0].shape, stride=32)
        if stride == 32
        else FeatureSpec(
            name=f"feature_stride{stride}",
            shape=(1, channels_of[stride], height // stride, width // stride),
            stride=stride,
        )
        for stride in strides
    )
    return Detector(
        file="backbone.onnx",
        input=InputSpec(
            name="image", width=width, height=height, resize="letterbox_topleft", colour="bgr", scale=1.0, pad=114
        ),
        decode="yolov3",
        heads=heads,
        features=features,
        classes=nano_classes(tuple(names)),
    )


@torch.no_grad()
def validate(network: Nano, examples: Sequence[Example], names: Sequence[str], size: int) -> dict[str, Any]:
    """`average_precision` of a network over examples of longer side `size` px."""
    was_training = network.training
    network.eval()
    detector = nano_detector(names, size, size)
    decode = Decoder(detector, CONFIDENCE, NMS_IOU)
    scored = []
    for start in range(0, len(examples), BATCH):
        chunk = examples[start : start + BATCH]
        images = np.stack([plain(example, size).image for example in chunk])
        heads: Sequence[Tensor] = network(torch.from_numpy(images).permute(0, 3, 1, 2).float())
        for row, example in enumerate(chunk):
            outputs = {
                spec.name: head[row : row + 1].numpy() for spec, head in zip(detector.heads, heads[::-1], strict=True)
            }
            height, width = example.image.shape[:2]
            found = decode(outputs, place(detector.input, width, height))
            scored.append(
                ScoredPicture(
                    width,
                    height,
                    example.boxes.astype(np.float64),
                    example.labels,
                    found.boxes,
                    found.class_ids,
                    found.scores,
                    example.unasked,
                )
            )
    network.train(was_training)
    return average_precision(scored, names)
