"""A cut ONNX file gives the same outputs, from fewer nodes and weights."""

import numpy as np
import onnx
import onnxruntime as ort
import pytest

from edgemap.runtime.network.open_bundle import subgraph
from edgemap.runtime.network.store import bundle_folder


def test_outputs_are_those_of_the_whole_file_and_the_rest_is_gone():
    whole = (bundle_folder("edgemap-pico") / "backbone.onnx").read_bytes()
    names = ["floor"]
    cut = subgraph(whole, set(names))
    onnx.checker.check_model(onnx.load_from_string(cut))
    assert len(cut) < 0.7 * len(whole)
    picture = np.random.default_rng(0).uniform(0, 1, (1, 3, 416, 416)).astype(np.float32)
    expected, given = (ort.InferenceSession(model).run(names, {"image": picture}) for model in (whole, cut))
    for one, other in zip(expected, given, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_unknown_output_and_other_bytes_are_refused():
    whole = (bundle_folder("yolox-nano") / "backbone.onnx").read_bytes()
    with pytest.raises(KeyError, match="nothing"):
        subgraph(whole, {"nothing"})
    with pytest.raises(ValueError, match="no"):
        subgraph(b"\xff" * 100, {"output"})
