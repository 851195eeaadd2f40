"""A smaller flow head that is fitted, not trained: it moves as the larger one does, in half the time."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from support.floor_drive import floor_drive  # noqa: E402

from edgemap.export.odometry.flow import FlowHead, FlowSizes  # noqa: E402
from edgemap.export.odometry.recipe import estimate, flow_recipe  # noqa: E402
from edgemap.export.odometry.smaller import fit_smaller  # noqa: E402

SIZES = FlowSizes(8, 16, 16, 12, 8, 2)


def moves(head: FlowHead, drive) -> np.ndarray:
    return np.array([step.vector() for step in estimate(head.eval(), flow_recipe().unroll, drive)[0]])


def test_fitted_it_moves_as_the_larger_one():
    """Nobody trained this one, so it gets no smaller: its descriptions are turned, and all behind them fitted again."""
    torch.manual_seed(0)
    large = FlowHead((1, 8, 40, 40), 4, SIZES).eval()
    with torch.no_grad():
        large.feature_std.fill_(2.0)
        for layer in (large.tell, large.retell):
            layer.weight.normal_(std=0.03)
    small = FlowHead((1, 8, 40, 40), 4, SIZES)
    small.feature_std.copy_(large.feature_std)
    drives = [floor_drive(seed) for seed in range(4)]
    unseen = floor_drive(90)
    wanted, unfitted = moves(large, unseen), moves(small, unseen)
    fit_smaller(small, large, [(drive, drive) for drive in drives], every=1)
    assert np.abs(moves(small, unseen) - wanted).mean() < 0.3 * np.abs(unfitted - wanted).mean()
