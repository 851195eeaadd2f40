from pathlib import Path

import pytest

from edgemap.benchmarks.beside import FRAMES, block_figures, start_worker, timed_block, without_floor_head
from edgemap.runtime import load_bundle

REPOSITORY = Path(__file__).parents[2]


def test_figures_of_blocks_are_of_all_their_frames():
    found = block_figures([([10.0, 20.0], 0.030, 0.1), ([30.0, 20.0], 0.050, 0.1)])
    assert found["p50_ms"] == 20.0
    assert found["cpu_ms_per_frame"] == pytest.approx(20.0)
    assert found["cpu_percent"] == pytest.approx(40.0)
    assert found["fps"] == 50.0


def test_a_build_runs_from_its_own_tree():
    worker = start_worker(REPOSITORY, "1", "edgemap-nano", "onnxruntime")
    times_ms, spent_s, wall_s = timed_block(worker, 0.0)
    assert len(times_ms) == FRAMES
    assert spent_s > 0.0
    assert wall_s >= sum(times_ms) / 1e3
    worker.communicate()


def test_a_tree_without_the_step_is_not_completed_by_an_installed_package(tmp_path):
    for room in ("geometry", "models"):
        (tmp_path / room).symlink_to(REPOSITORY / room)
    worker = start_worker(tmp_path, "1", "edgemap-nano", "onnxruntime")
    worker.communicate()
    assert worker.returncode == 1


def test_a_bundle_loses_its_floor_head(tmp_path):
    pytest.importorskip("onnx")
    bare = load_bundle(without_floor_head("edgemap-nano", tmp_path / "b"), 1)
    assert bare.manifest.detector.floor is None
    assert bare.manifest.odometry["flow"].trained
