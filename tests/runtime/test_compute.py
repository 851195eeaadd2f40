"""Threads and spinning: what the trial settles on, and that they change no result."""

import numpy as np
import pytest

from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.compute import ONE_THREAD_MS, settle
from edgemap.runtime.network.engines import open_onnxruntime
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.network.store import bundle_folder

SLEEPING, SPINNING = Compute(2), Compute(2, spin=True)


@pytest.mark.parametrize(
    ("pace", "one_ms", "two_ms", "chosen"),
    [
        ("camera", ONE_THREAD_MS - 1, 1, Compute(1)),  # one thread is quick enough: the other core is the planner's
        ("camera", 40, 22, SLEEPING),
        ("camera", 40, 39, Compute(1)),
        ("files", 8, 4.5, SPINNING),
        ("files", 20, 45, Compute(1)),  # spinning on a busy machine
    ],
)
def test_the_trial_settles_threads_by_pace_and_time(monkeypatch, pace, one_ms, two_ms, chosen):
    monkeypatch.setattr("edgemap.runtime.network.compute.default_threads", lambda: 2)
    now = [0.0]

    def opened(compute):
        def infer(tensors):
            now[0] += 1e-3 * (one_ms if compute.threads == 1 else two_ms)
            return [np.zeros(1, np.float32)]

        return Network({"image": (1,)}, {"head": (1,)}, infer)

    assert settle(opened, pace, clock=lambda: now[0])[1] == chosen


@pytest.mark.parametrize(
    ("pace", "threads", "chosen"),
    [("camera", 2, SLEEPING), ("files", 2, SPINNING), ("files", 1, Compute(1)), ("camera", 1, Compute(1))],
)
def test_asked_threads_need_no_trial(pace, threads, chosen):
    assert settle(lambda compute: Network({}, {}, lambda tensors: []), pace, threads)[1] == chosen


def test_threads_change_no_bit_of_the_outputs():
    folder, random = bundle_folder("edgemap-nano"), np.random.default_rng(0)
    for name in ("backbone.onnx", "odometry.flow.onnx"):
        networks = [open_onnxruntime(folder / name, compute, 416) for compute in (Compute(1), SLEEPING, SPINNING)]
        tensors = {key: random.uniform(0, 1, shape).astype(np.float32) for key, shape in networks[0].inputs.items()}
        expected, *others = [network.run(tensors) for network in networks]
        for found in others:
            for key, value in expected.items():
                np.testing.assert_array_equal(found[key], value)


def test_blas_computes_on_one_thread_once_a_bundle_is_loaded():
    from threadpoolctl import threadpool_info

    load_bundle(bundle_folder("edgemap-nano"), threads=1)
    assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {1}
