"""A smaller flow head that is fitted, not trained: it moves as the larger one does, in half the time."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from support.floor_drive import floor_drive  # noqa: E402

from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head  # noqa: E402
from edgemap.export.odometry.correlation import FilledConv  # noqa: E402
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


def test_sizes_are_kept_in_the_checkpoint_and_checked(tmp_path: Path):
    head = FlowHead((1, 8, 40, 40), 4, SIZES)
    save_head(HeadCheckpoint(head, "edgemap-nano", "stride4", "flow"), tmp_path / "best.pt")
    found = load_head(tmp_path / "best.pt").head
    assert isinstance(found, FlowHead)
    assert found.sizes == SIZES
    document = torch.load(tmp_path / "best.pt", weights_only=True)
    torch.save(document | {"sizes": {"wide": 3}}, tmp_path / "wrong.pt")
    with pytest.raises(ExportError, match="describes no network"):
        load_head(tmp_path / "wrong.pt")


@pytest.mark.parametrize("channels", [7, 8])
def test_a_filled_convolution_gives_the_same_numbers(channels):
    filled = FilledConv(channels, 5, 3, 2, 1)
    plain = torch.nn.Conv2d(channels, 5, 3, 2, 1)
    plain.load_state_dict(filled.state_dict())
    picture = torch.randn(2, channels, 9, 11)
    torch.testing.assert_close(filled(picture), plain(picture))
