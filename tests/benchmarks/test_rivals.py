"""The rival's loop finds the boxes that ours finds, with none of our code."""

import numpy as np
import pytest

from edgemap.benchmarks.rivals import picture_to_boxes
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.store import bundle_folder


@pytest.mark.parametrize("name", ["edgemap-nano", "yolox-nano", "edgemap-pico"])
def test_the_rivals_loop_finds_our_boxes(name):
    bundle = load_bundle(bundle_folder(name), threads=1)
    spec = bundle.manifest.detector
    with open_camera("demo") as camera:
        frames = [camera.read() for _ in range(40)]

    def infer(tensor):
        found = bundle.backbone.run({spec.input.name: tensor})
        return [found[head.name] for head in spec.heads]

    theirs, ours = picture_to_boxes(spec, infer, 0.5), Detector(bundle, Decoder(spec, 0.5))
    both = 0
    for frame in frames[::8]:
        assert frame is not None
        corners, scores, _ = theirs(frame.image)  # type: ignore[misc]
        found = ours(frame.image)
        assert len(scores) <= len(found)  # theirs suppresses across classes
        for corner, size, score in zip(corners[:, :2], corners[:, 2:], scores, strict=True):
            box = np.concatenate([corner, corner + size]).clip(0, [640, 480, 640, 480])
            both += bool((np.abs(found.boxes - box).max(axis=1) + 100 * np.abs(found.scores - score)).min() < 2.0)
    assert both > 0
