"""Engines behind the one Network: the same outputs, and a choice that is tried once and remembered."""

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from edgemap.cli.network_options import chosen_engine, chosen_precision
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.frames.decisions import Decisions
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.odometry.learned import LearnedOdometry
from edgemap.runtime.network import compute
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.compute import best_engine, computes_bf16, stored_engine
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.network.preprocess import Preprocessor
from edgemap.runtime.network.store import bundle_folder

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


INTERRUPTED = """
import gc, os, signal
from pathlib import Path
from edgemap.runtime.network.bundle import load_bundle

signal.signal(signal.SIGINT, lambda *_: print("handled", flush=True))
first, second = (load_bundle(Path({folder!r}), 1, engine="openvino") for _ in range(2))
del first
gc.collect()
del second
gc.collect()
os.kill(os.getpid(), signal.SIGINT)
"""


@pytest.mark.parametrize("options", [[], ["-X", "faulthandler"]], ids=["plain", "faulthandler"])
def test_ctrl_c_after_a_released_openvino_network_is_handled(options):
    """Two of its cores leave a signal stack that is unmapped once both are released."""
    pytest.importorskip("openvino")
    command = [sys.executable, *options, "-c", INTERRUPTED.format(folder=str(NANO))]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, "handled\n"), ended.stderr


def test_a_replay_takes_the_recorded_engine_unless_another_is_asked_for(monkeypatch, capsys):
    recorded = Decisions("openvino", "int8")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    assert (chosen_engine("default", recorded), chosen_precision("default", recorded)) == ("openvino", "int8")
    assert (chosen_engine("auto", recorded), chosen_precision("float32", recorded)) == ("auto", "float32")
    assert (chosen_engine("default"), chosen_precision("default")) == ("onnxruntime", "float32")
    assert not capsys.readouterr().err
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert chosen_engine("default", recorded) == "onnxruntime"
    assert "recorded with openvino, which is not installed" in capsys.readouterr().err


@pytest.mark.parametrize(("engine", "off_m"), [("openvino", 1e-6), ("openvino-bf16", 0.003)])
def test_flow_odometry_moves_the_same_in_openvino(monkeypatch, engine, off_m):
    """In float32 the choice of onnxruntime for it is one of time alone."""
    pytest.importorskip("openvino")
    bundle = load_bundle(NANO, 1)
    with open_camera("demo") as camera:
        assert camera.intrinsics
        assert camera.mount
        floor = FloorCamera(camera.intrinsics, camera.mount)
        frames = [frame for _ in range(6) if (frame := camera.read()) is not None]
    odometries = [LearnedOdometry(bundle, "flow", floor)]
    with monkeypatch.context() as patch:
        head = NANO / "odometry.flow.onnx"
        contract = open_network(head, Compute()).metadata  # which onnxruntime reads
        other = replace(open_network(head, Compute(1, engine=engine)), metadata=contract)
        patch.setattr("edgemap.runtime.network.bundle.open_network", lambda *_: other)
        odometries.append(LearnedOdometry(bundle, "flow", floor))
    fitted = bundle.for_pictures(camera.intrinsics.width, camera.intrinsics.height)
    preprocess = Preprocessor(fitted.detector.input)
    for frame in frames:
        features = fitted.backbone.run({fitted.detector.input.name: preprocess(frame.image)[0]})
        ours, theirs = (odometry.step(frame, features).motion.vector() for odometry in odometries)
        np.testing.assert_allclose(theirs, ours, atol=off_m)


@pytest.mark.skipif(not computes_bf16(), reason="this processor has no bf16")
def test_with_16_bits_the_odometry_runs_beside_the_backbone_unless_it_disagrees(monkeypatch):
    pytest.importorskip("openvino")
    opened = []
    monkeypatch.setattr(
        "edgemap.runtime.network.bundle.open_network", lambda *a: opened.append(a[1].engine) or open_network(*a)
    )
    bundle = load_bundle(NANO, 1, engine="openvino-bf16")
    del opened[:]
    bundle.odometry_head("flow")
    assert opened == ["openvino-bf16", "onnxruntime"]  # the second one to compare with
    monkeypatch.setitem(compute.TOLERANCE, "openvino-bf16", 0.0)
    bundle.odometry_head("flow")
    assert opened[2:] == ["openvino-bf16", "onnxruntime", "onnxruntime"]


def test_an_engine_that_disagrees_is_refused(monkeypatch):
    pytest.importorskip("openvino")
    monkeypatch.setitem(compute.TOLERANCE, "openvino", 0.0)
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

    monkeypatch.setattr(compute, "minimum_ms", times.__getitem__)
    assert best_engine(list(times), load) == chosen


def test_the_choice_is_tried_once_for_each_bundle(monkeypatch, tmp_path):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    monkeypatch.setattr(compute, "available_engines", lambda: ("onnxruntime", "openvino"))
    loaded = []

    def load(engine):
        loaded.append(engine)
        return Network({}, {}, lambda tensors: [])

    first = stored_engine("a", load)
    assert loaded == ["onnxruntime", "openvino"]
    assert stored_engine("a", load) == first
    assert len(loaded) == 2
    stored_engine("b", load)
    assert len(json.loads((tmp_path / "engines.json").read_text())) == 2
    (tmp_path / "engines.json").write_text("[")
    assert stored_engine("a", load) in ("onnxruntime", "openvino")
