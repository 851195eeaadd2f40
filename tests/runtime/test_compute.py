"""Threads and spinning: the defaults, and that they change no result."""

import numpy as np
import pytest

from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.engines import compute_at, open_onnxruntime
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.store import bundle_folder

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
