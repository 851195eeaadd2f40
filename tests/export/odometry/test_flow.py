"""The flow head: its state, what it learns on a textured floor, its file, and the clips it learns from."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from support.floor_drive import floor_drive  # noqa: E402

from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head  # noqa: E402
from edgemap.export.odometry.clips import LONGEST_DT_S, ClipDraws, Clips, make_batch, reach_m  # noqa: E402
from edgemap.export.odometry.flow import FlowHead  # noqa: E402
from edgemap.export.odometry.flow_loss import flow_loss, run_clip  # noqa: E402
from edgemap.export.odometry.recipe import estimate, flow_recipe, validate  # noqa: E402
from edgemap.export.odometry.start import unit_of  # noqa: E402


def new_head() -> FlowHead:
    torch.manual_seed(0)
    head = FlowHead((1, 8, 40, 40), 4)
    head.feature_std.fill_(2.0)
    return head


def test_it_learns_to_tell_motion_from_a_textured_floor():
    train, unseen = [floor_drive(seed) for seed in range(6)], [floor_drive(seed) for seed in (90, 91)]
    head, recipe = new_head(), flow_recipe(1e-3, 5)
    optimizer = recipe.optimizer(head)
    before, draws = validate(head, recipe.unroll, unseen), ClipDraws(recipe.clips, train)
    for step in range(80):
        rng = np.random.default_rng(step)
        loss, _ = recipe.loss(head, make_batch([draws.draw(rng) for _ in range(3)]), 0.5)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(head.parameters(), 1.0)
        optimizer.step()
    after = validate(head, recipe.unroll, unseen)
    assert after["rmse_yaw_rad"] < 0.5 * before["rmse_yaw_rad"]
    assert after["rmse_forward_m"] < 0.5 * before["rmse_forward_m"]


def test_the_state_carries_everything_from_chunk_to_chunk():
    drive, head, recipe = floor_drive(3, frames=12), new_head(), flow_recipe()
    whole, _, _ = recipe.unroll(head, make_batch([(drive, np.arange(12))]), None)
    first, _, state = recipe.unroll(head, make_batch([(drive, np.arange(6))]), None)
    second, _, _ = recipe.unroll(head, make_batch([(drive, np.arange(5, 12))]), state)
    torch.testing.assert_close(torch.cat([first, second], dim=1), whole, atol=1e-6, rtol=1e-5)
    steps, covariances = estimate(head, recipe.unroll, drive)
    assert covariances is not None
    assert (len(steps), covariances.shape) == (11, (11, 3, 3))


def test_a_unit_of_length_is_a_larger_world():
    """Eight times as high and as fast, counted in units of 8 m: the same head tells 8 times the motion."""
    drive, head = floor_drive(3, frames=6), new_head().eval()
    cells, mount = drive.cells.copy(), drive.mount.copy()
    cells[:, 6] /= 8.0
    mount[:, 9:] *= 8.0
    large = replace(drive, cells=cells, mount=mount, poses=drive.poses * [8.0, 8.0, 1.0])
    assert (unit_of([drive, drive, large]), unit_of([large])) == (1.0, 4.0)  # its floor begins 0.58 m ahead
    recipe, batches = flow_recipe(), [make_batch([(each, np.arange(6))]) for each in (drive, large)]
    motions, covariances, _ = recipe.unroll(head, batches[0], None)
    loss = flow_loss(head, batches[0], 0.5)[0]
    head.unit_m = 8.0
    units = torch.tensor([8.0, 8.0, 1.0])
    found, told, _ = recipe.unroll(head, batches[1], None)
    torch.testing.assert_close(found, motions * units, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(told, covariances * units[:, None] * units, atol=1e-8, rtol=1e-3)
    torch.testing.assert_close(flow_loss(head, batches[1], 0.5)[0], loss, atol=1e-4, rtol=1e-4)
    # It lies 0.86 below the horizon there; 3 cells of 16 px of 130 are 0.43 of that: 0.58 m * 0.43 / 1.43.
    assert (reach_m(drive), reach_m(large)) == pytest.approx((0.174, 8 * 0.174), rel=0.01)


def test_one_step_at_a_time_is_the_same_as_a_clip():
    drive, head = floor_drive(4, frames=5), new_head().eval()
    batch = make_batch([(drive, np.arange(5))])
    with torch.no_grad():
        looks, _ = run_clip(head, batch)
        state = [torch.zeros(shape) for shape in head.state_shapes.values()]
        for index in range(5):
            motion, covariance, *state = head(
                batch.features[:, index],
                batch.cells[:, index],
                batch.mount[:, index],
                batch.dt_s[:, index : index + 1],
                *state,
            )
            if index == 0:
                state[2:] = [torch.zeros_like(part) for part in state[2:]]  # a clip's memory starts at frame 1
            else:
                torch.testing.assert_close(motion, looks[index - 1][1].solution.motion, atol=1e-5, rtol=1e-4)
                torch.testing.assert_close(covariance, looks[index - 1][1].solution.covariance, atol=1e-8, rtol=1e-3)


def test_the_loss_prefers_the_truth_and_honest_doubt():
    drive, head = floor_drive(5), new_head()
    batch = make_batch([(drive, np.arange(6))])
    total, parts = flow_loss(head, batch, 0.0)
    assert set(parts) == {"motion", "coarse"}
    wrong = make_batch([(drive, np.arange(6))])
    wrong.motions[..., 2] += 0.2
    assert flow_loss(head, wrong, 0.0)[0].item() > total.item()


def test_a_checkpoint_gives_the_head_back(tmp_path):
    head = new_head()
    head.unit_m = 4.0
    save_head(HeadCheckpoint(head, "edgemap-nano", "stride4", "flow", measured={"a": 1}), tmp_path / "best.pt")
    found = load_head(tmp_path / "best.pt")
    assert (found.kind, found.feature, found.measured) == ("flow", "stride4", {"a": 1})
    assert (found.head.stride, found.head.unit_m) == (4, 4.0)
    for name, tensor in head.state_dict().items():
        torch.testing.assert_close(found.head.state_dict()[name], tensor)
    with pytest.raises(ExportError, match="stride 16; 4 or 8 are wanted"):
        FlowHead((1, 8, 10, 10), 16)


def test_clips_skip_turn_round_and_stand_still():
    drive, rng = floor_drive(6), np.random.default_rng(0)
    steps = [np.diff(ClipDraws(Clips(length=4, still=0.5), [drive]).draw(rng)[1]) for _ in range(80)]
    assert {-1, 0, 1, 2} <= {int(step) for row in steps for step in row}
    for row in steps:
        assert np.abs(row).max() * 0.1 <= LONGEST_DT_S
    chosen = [(drive, np.array([3, 5, 7, 7]))]
    batch = make_batch(chosen)
    assert batch.dt_s[0].tolist() == pytest.approx([0.2] * 4)
    assert batch.motions[0, 3].tolist() == pytest.approx([0.0, 0.0, 0.0])
    assert batch.motions[0, 1].tolist() == pytest.approx(drive.motions(np.array([3, 5]))[0].tolist())
    with pytest.raises(ExportError, match="24 frames, clips need 30"):
        ClipDraws(Clips(length=30), [drive])
