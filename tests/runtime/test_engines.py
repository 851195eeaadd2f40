"""Engines behind the one Network: the same outputs."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from edgemap.cli.network_options import NetworkOptions
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.network.bundle import ENGINE_TOLERANCE, load_bundle
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
    recorded = Inference("openvino", "int8")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    assert NetworkOptions().inference(recorded) == recorded
    assert NetworkOptions(precision="float32", engine="onnxruntime").inference(recorded) == Inference()
    assert NetworkOptions().inference() == Inference("onnxruntime", "float32")
    assert not capsys.readouterr().err
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert NetworkOptions().inference(recorded) == Inference("onnxruntime", "int8")
    assert "recorded with openvino, which is not installed" in capsys.readouterr().err


def test_an_engine_that_disagrees_is_refused(monkeypatch):
    pytest.importorskip("openvino")
    monkeypatch.setitem(ENGINE_TOLERANCE, "float32", 0.0)
    with pytest.raises(BundleError, match=r"backbone\.onnx: openvino gives other outputs than onnxruntime"):
        load_bundle(NANO, 1, engine="openvino")
