"""Engines behind the one Network: the same outputs, and a choice that is tried once and remembered."""

import json

import numpy as np
import pytest

from edgemap.runtime import engine_choice
from edgemap.runtime.bundle import load_bundle
from edgemap.runtime.engine_choice import best_engine, remembered_engine
from edgemap.runtime.errors import BundleError
from edgemap.runtime.network import Network
from edgemap.runtime.store import bundle_folder

NANO = bundle_folder("edgemap-nano")


def test_openvino_gives_onnxruntimes_outputs_and_keeps_them():
    pytest.importorskip("openvino")
    theirs, ours = load_bundle(NANO, 1, engine="openvino"), load_bundle(NANO, 1)
    assert (theirs.engine, theirs.backbone.outputs) == ("openvino", ours.backbone.outputs)
    picture = np.random.default_rng(1).uniform(0, 255, (1, 3, 416, 416)).astype(np.float32)
    expected, found = ours.backbone.run({"image": picture}), theirs.backbone.run({"image": picture})
    theirs.backbone.run({"image": picture * 0})
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=2e-4 * np.abs(value).max())


def test_an_engine_that_disagrees_is_refused(monkeypatch):
    pytest.importorskip("openvino")
    monkeypatch.setitem(engine_choice.TOLERANCE, "openvino", 0.0)
    with pytest.raises(BundleError, match=r"backbone\.onnx: openvino gives other outputs than onnxruntime"):
        load_bundle(NANO, 1, engine="openvino")


@pytest.mark.parametrize(
    ("times", "chosen"),
    [
        ({"onnxruntime": 8.0, "openvino": 7.9, "openvino-bf16": 7.4}, "onnxruntime"),
        ({"onnxruntime": 8.0, "openvino": 7.0, "openvino-bf16": 5.0}, "openvino-bf16"),
        ({"onnxruntime": 8.0, "openvino": 6.0, "openvino-bf16": None}, "openvino"),  # None: its outputs disagree
    ],
)
def test_another_engine_must_be_clearly_faster(monkeypatch, times, chosen):
    def load(engine):
        if times[engine] is None:
            raise BundleError("other outputs")
        return engine

    monkeypatch.setattr(engine_choice, "least_ms", times.__getitem__)
    assert best_engine(list(times), load) == chosen


def test_the_choice_is_tried_once_for_each_bundle(monkeypatch, tmp_path):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    monkeypatch.setattr(engine_choice, "available_engines", lambda: ("onnxruntime", "openvino"))
    loaded = []

    def load(engine):
        loaded.append(engine)
        return Network({}, {}, lambda tensors: [])

    first = remembered_engine("a", load)
    assert loaded == ["onnxruntime", "openvino"]
    assert remembered_engine("a", load) == first
    assert len(loaded) == 2
    remembered_engine("b", load)
    assert len(json.loads((tmp_path / "engines.json").read_text())) == 2
    (tmp_path / "engines.json").write_text("[")
    assert remembered_engine("a", load) in ("onnxruntime", "openvino")
