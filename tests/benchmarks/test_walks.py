"""Figures of a walk by hand, and one real walk through the front end and the map."""

import math

import numpy as np
import pytest

from edgemap.benchmarks.walks import WalksOptions, summary, table, walk, walk_errors
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config


def straight(step_m, count):
    return Trajectory(np.arange(count) / 10.0, tuple(SE2(step_m * i, 0.0, 0.0) for i in range(count)))


def test_a_walk_that_is_a_tenth_too_long():
    truth = straight(0.25, 41)
    steps = [SE2(0.275, 0.0, 0.0)] * 40
    found = walk_errors(truth, truth.stamps_s.tolist(), steps, np.tile(np.eye(3) * 0.01, (40, 1, 1)))
    # A segment of L ends at the first frame beyond L: one step of 0.25 m more, each 10 % too long.
    assert found["t_rel_5"] == pytest.approx(100.0 * 0.1 * 5.25 / 5.0)
    assert found["scale"] == pytest.approx(1.1)
    assert found["r_rel_5"] == pytest.approx(0.0)
    assert found["end_m"] == pytest.approx(1.0)
    assert found["nees_1"] == pytest.approx((10 * 0.025) ** 2 / (10 * 0.01) / 3)


def test_a_turn_that_is_missed_counts_by_metre():
    truth = Trajectory(np.arange(3) / 10.0, (SE2(), SE2(6.0, 0.0, math.radians(12.0)), SE2(12.0, 1.0, 0.5)))
    found = walk_errors(truth, truth.stamps_s.tolist(), [SE2(6.0, 0.0, 0.0)] * 2, np.tile(np.eye(3), (2, 1, 1)))
    assert (found["r_rel_5"] or 0.0) > 2.0


def test_means_and_the_worst_run_of_each_figure():
    row = dict.fromkeys(summary([])["mean"], 1.0) | {"f1": 0.5, "scale": 0.8}
    rows = [row, row | {"t_rel_5": 3.0, "f1": 0.4, "scale": 1.1}, row | {"f1": None}]
    found = summary(rows)
    assert found["mean"]["t_rel_5"] == pytest.approx(5.0 / 3.0)
    assert (found["worst"]["t_rel_5"], found["worst"]["f1"], found["worst"]["scale"]) == (3.0, 0.4, 0.8)
    assert found["mean"]["f1"] == pytest.approx(0.45)
    assert len(table("walk", {"runs": rows, **found})) == 4


def test_a_real_walk(shared_data):
    folder = shared_data / "lounge"
    if not (folder / "depth").is_dir():
        pytest.skip(f"no {folder} with depth here")
    spec = f"c2w:{folder}"
    drive = open_drive(spec)
    assert len(drive.depth) == len(drive.images) == 90
    found = walk(drive, load_bundle(bundle_folder("edgemap-pico")), Config(), WalksOptions((spec,), frames=30))
    assert found["lost"] == 0
    assert (found["t_rel_1"] or math.inf) < 15.0
    assert found["t_rel_5"] is None  # so far it does not go
