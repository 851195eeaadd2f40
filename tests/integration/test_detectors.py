"""Detectors as real packages export them, each in an environment of its own: our boxes are those of the package.

Weights are random: nothing is downloaded but the packages. torch, onnx and numpy are those of this environment.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from edgemap.geometry.objects.visibility import iou
from edgemap.runtime.frames.class_names import COCO_91
from edgemap.runtime.network.foreign import ForeignFile, recognise
from edgemap.runtime.network.layouts import rows_of
from edgemap.runtime.network.network import Compute

pytestmark = pytest.mark.skipif("EDGEMAP_INTEGRATION" not in os.environ, reason="real packages: make integration")
# torchvision 0.28 is the one for torch 2.13; its wheels hold no kernels for a processor.
ULTRALYTICS = ("ultralytics==8.4.190", "torchvision==0.28.0")
PACKAGES = {
    "yolov8n": ULTRALYTICS, "yolov10n": ULTRALYTICS, "yolo11n": ULTRALYTICS, "yolo26n": ULTRALYTICS, "rt-detr":
    ("transformers==5.24.0",), "d-fine": ("transformers==5.24.0",), "rf-detr": ("rfdetr==1.11.2",
    "transformers==5.24.0", "torchvision==0.28.0"), "ssdlite": ULTRALYTICS,
}  # fmt: skip


@pytest.fixture(scope="module")
def python_of(tmp_path_factory):
    """A package's own environment, which sees this one's packages beneath its own."""
    made: dict[tuple[str, ...], Path] = {}

    def python(packages):
        if packages not in made:
            folder = tmp_path_factory.mktemp("environment")
            subprocess.run([sys.executable, "-m", "venv", folder], check=True)
            (site,) = folder.glob("lib/python*/site-packages")
            (site / "beneath.pth").write_text(sysconfig.get_path("purelib"))
            subprocess.run([folder / "bin/python", "-m", "pip", "install", "-q", *packages], check=True)
            made[packages] = folder / "bin/python"
        return made[packages]

    return python


@pytest.mark.parametrize("name", PACKAGES)
def test_boxes_are_those_of_the_package(name, python_of, tmp_path):
    script = Path(__file__).with_name("detectors.py")
    subprocess.run([python_of(PACKAGES[name]), script, name, tmp_path], check=True, timeout=600)
    file, own = ForeignFile(tmp_path / "model.onnx", Compute(1)), np.load(tmp_path / "boxes.npz")
    read = recognise(file, COCO_91 if name == "ssdlite" else None, checked=False)
    limits = [read.input.width, read.input.height] * 2
    size = (read.input.width, read.input.height)
    boxes, scores, labels = rows_of(file.run(own["tensor"]), read.reading, len(read.names), 0.001, size)
    boxes, theirs = np.clip(boxes, 0, limits), np.clip(own["boxes"], 0, limits)
    order = np.argsort(-own["scores"], kind="stable")
    order = order[(theirs[order, 2:] > theirs[order, :2]).all(axis=1)]  # the others lie outside
    _, first = np.unique(theirs[order].round(2), axis=0, return_index=True)  # the best label of each box
    for row in order[np.sort(first)][:50]:
        same = np.flatnonzero(labels == own["labels"][row])
        match = iou(theirs[row], boxes[same]) >= 0.99
        assert np.abs(scores[same][match] - own["scores"][row]).min(initial=1.0) < 1e-3
