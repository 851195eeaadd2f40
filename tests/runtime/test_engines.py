"""Engines behind the one Network: the same outputs, on the threads that were chosen."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from edgemap.cli.network_options import NetworkOptions
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.network.bundle import ENGINE_TOLERANCE, load_bundle
from edgemap.runtime.network.engines import compute_at, open_onnxruntime
from edgemap.runtime.network.network import Compute
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


SLEEPING, SPINNING = Compute(2), Compute(2, spin=True)


@pytest.mark.parametrize(
    ("pace", "cores", "threads", "expected"),
    [
        ("camera", 4, None, Compute(1)),
        ("camera", 4, 2, SLEEPING),
        ("files", 4, None, SPINNING),
        ("files", 1, None, Compute(1)),
        ("files", 4, 1, Compute(1)),
    ],
)
def test_threads_follow_the_pace_unless_they_are_stated(monkeypatch, pace, cores, threads, expected):
    monkeypatch.setattr("edgemap.runtime.network.engines._cores", lambda: cores)
    assert compute_at(pace, threads) == expected


def test_threads_change_no_bit_of_the_outputs():
    path, random = bundle_folder("edgemap-nano") / "backbone.onnx", np.random.default_rng(0)
    networks = [open_onnxruntime(path, compute, 416) for compute in (Compute(1), SLEEPING, SPINNING)]
    tensors = {key: random.uniform(0, 1, shape).astype(np.float32) for key, shape in networks[0].inputs.items()}
    expected, *others = [network.run(tensors) for network in networks]
    for found in others:
        for key, value in expected.items():
            np.testing.assert_array_equal(found[key], value)


def test_blas_computes_on_one_thread_once_a_bundle_is_loaded():
    from threadpoolctl import threadpool_info

    load_bundle(bundle_folder("edgemap-nano"), threads=1)
    assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {1}


def test_a_network_that_fails_as_it_runs_is_the_bundles_failure(tmp_path):
    onnx = pytest.importorskip("onnx")
    helper = onnx.helper
    kinds = onnx.TensorProto
    values = (("x", kinds.FLOAT, (1, 4)), ("shape", kinds.INT64, (2,)), ("y", kinds.FLOAT, (None, None)))
    *given, made = (helper.make_tensor_value_info(*value) for value in values)
    graph = helper.make_graph([helper.make_node("Reshape", ["x", "shape"], ["y"])], "g", given, [made])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = tmp_path / "a.onnx"
    onnx.save(model, path)
    network = open_onnxruntime(path, Compute(1))
    with pytest.raises(BundleError, match="the network fails as it runs") as caught:
        network.run({"x": np.zeros((1, 4), np.float32), "shape": np.array([3, 3])})
    assert str(caught.value).isprintable()
