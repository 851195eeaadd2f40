import pytest

from edgemap.benchmarks.beside import _figures


def test_figures_of_blocks_are_of_all_their_frames():
    found = _figures([([10.0, 20.0], 0.030, 0.1), ([30.0, 20.0], 0.050, 0.1)])
    assert found["p50_ms"] == 20.0
    assert found["cpu_ms_per_frame"] == pytest.approx(20.0)
    assert found["cpu_percent"] == pytest.approx(40.0)
    assert found["fps"] == 50.0
