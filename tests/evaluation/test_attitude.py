import math

import numpy as np
import pytest

from edgemap.evaluation.trajectory import attitude_figures
from edgemap.geometry.camera.attitude import Attitude


def attitude(roll_deg, pitch_deg, sigma_deg=0.5, source="imu"):
    return Attitude(
        math.radians(roll_deg), math.radians(pitch_deg), np.eye(2) * math.radians(sigma_deg) ** 2, source=source
    )


def test_errors_by_hand():
    found = [attitude(0.0, 11.0), attitude(0.0, 9.0, source="depth"), attitude(-1.0, 10.0), None]
    figures = attitude_figures(found, [attitude(0.0, 10.0)] * 4)
    assert figures["sources"] == {"imu": 0.5, "depth": 0.25, "none": 0.25}
    assert figures["pitch_rms_deg"] == pytest.approx(math.sqrt(2.0 / 3.0))
    assert figures["roll_rms_deg"] == pytest.approx(math.sqrt(1.0 / 3.0))
    assert figures["max_deg"] == pytest.approx(1.0)
    assert figures["nees"] == pytest.approx(4.0)  # each is two standard deviations off


def test_a_turn_round_is_no_error_and_without_truth_there_are_sources_only():
    assert attitude_figures([attitude(179.5, 0.0)], [attitude(-179.5, 0.0)])["max_deg"] == pytest.approx(1.0)
    assert attitude_figures([attitude(0.0, 1.0)], None) == {
        "sources": {"imu": 1.0}, "pitch_rms_deg": None, "roll_rms_deg": None, "max_deg": None, "nees": None,
    }  # fmt: skip
