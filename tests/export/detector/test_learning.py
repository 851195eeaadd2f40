"""Assignment, loss, augmentation and the training loop."""

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from edgemap.export.detector.assign import Targets, assign  # noqa: E402
from edgemap.export.detector.augment import PAD, flip, mosaic, plain, single  # noqa: E402
from edgemap.export.detector.begin import begin  # noqa: E402
from edgemap.export.detector.blend import blend, choose_blend  # noqa: E402
from edgemap.export.detector.boxes import cells_of, decode, flatten, generalised_iou, overlap  # noqa: E402
from edgemap.export.detector.loader import Batches, collate, rarity  # noqa: E402
from edgemap.export.detector.loss import detection_loss  # noqa: E402
from edgemap.export.detector.network import Nano  # noqa: E402
from edgemap.export.detector.store import Example, load_examples  # noqa: E402
from edgemap.export.detector.train import Settings, Trainer  # noqa: E402
from edgemap.export.errors import ExportError  # noqa: E402

CLASSES = ("chair", "couch")


def example(boxes, labels, visible=None, size=(96, 128), colour=(0, 0, 255)):
    """Blue-free grey picture with each box filled."""
    image = np.full((*size, 3), 60, np.uint8)
    for x0, y0, x1, y1 in boxes:
        image[round(y0) : round(y1), round(x0) : round(x1)] = colour
    boxes = np.array(boxes, np.float32).reshape(-1, 4)
    visible = np.ones(len(boxes), np.float32) if visible is None else np.array(visible, np.float32)
    return Example(image, boxes, np.array(labels, np.int64), visible, np.zeros(len(boxes), bool))


def targets(boxes, labels, ignored=None):
    boxes = torch.tensor(boxes, dtype=torch.float32)[None]
    ignored = torch.zeros(boxes.shape[1], dtype=torch.bool) if ignored is None else torch.tensor(ignored)
    return Targets(boxes, torch.tensor(labels)[None], ~ignored[None], ignored[None])


def blank(classes=2, size=128):
    """Heads that say nothing: objectness low, boxes of the anchor's size."""
    heads = [torch.zeros(1, 5 + classes, size // s, size // s) for s in (8, 16, 32)]
    for head in heads:
        head[:, 4:] = -4.0
    return heads


def test_overlap_by_hand():
    """10x10 boxes 5 apart: common 50, union 150; hull 15x10 = union, so GIoU = IoU. Apart: hull 30x10, union 200."""
    a = torch.tensor([[0.0, 0, 10, 10], [0, 0, 10, 10]])
    b = torch.tensor([[5.0, 0, 15, 10], [20, 0, 30, 10]])
    iou, giou = generalised_iou(a, b)
    assert iou.tolist() == pytest.approx([1 / 3, 0.0])
    assert giou.tolist() == pytest.approx([1 / 3, -1 / 3])
    assert torch.diagonal(overlap(a, b)).tolist() == pytest.approx([1 / 3, 0.0])


def test_a_box_gets_cells_near_its_centre_on_the_stride_of_its_size():
    """A 24 px box fits stride 8's anchor (24 px) best: its cells lie within 2.5 cells of the centre, on that stride."""
    heads = blank()
    rows, cells = flatten(heads), cells_of(heads)
    found = assign(rows, decode(rows, cells), cells, targets([[52.0, 52, 76, 76]], [1]))
    chosen = found.positive[0].nonzero().squeeze(1)
    assert 1 <= len(chosen) <= 10
    assert set(cells.strides[chosen].tolist()) == {8.0}
    assert (cells.centres[chosen] - 64.0).abs().max() < 2.5 * 8
    assert found.box[0, chosen].unique().tolist() == [0]


def test_every_cell_has_one_box_and_every_box_a_cell():
    heads = blank()
    rows, cells = flatten(heads), cells_of(heads)
    truth = targets([[20.0, 20, 50, 60], [24.0, 20, 54, 60], [90, 90, 120, 120]], [0, 0, 1])
    found = assign(rows, decode(rows, cells), cells, truth)
    assert set(found.box[0, found.positive[0]].tolist()) == {0, 1, 2}


def test_cells_on_an_ignored_box_cost_nothing():
    """A confident box where truth is ignored: no penalty; where there is nothing: a penalty."""
    heads = blank()
    heads[0][0, 4, 8, 8] = 8.0  # a 24 px box at (68, 68)
    here, elsewhere = [56.0, 56, 80, 80], [0.0, 0, 24, 24]
    costs = [
        float(detection_loss(heads, targets([box, [100, 100, 124, 124]], [0, 1], [True, False]))["objectness"])
        for box in (here, elsewhere)
    ]
    assert costs[1] - costs[0] > 0.5


def test_loss_falls_towards_truth_only_heads():
    """Gradient steps on the raw heads alone end at the true boxes."""
    heads = [head.requires_grad_() for head in blank()]
    truth = targets([[30.0, 40, 70, 100]], [1])
    optimizer = torch.optim.Adam(heads, lr=0.2)
    for _ in range(80):
        optimizer.zero_grad()
        detection_loss(heads, truth)["total"].backward()
        optimizer.step()
    rows, cells = flatten(heads).detach(), cells_of(heads)
    best = (torch.sigmoid(rows[0, :, 4:5]) * torch.sigmoid(rows[0, :, 5:])).amax(1).argmax()
    assert rows[0, best, 5:].argmax() == 1
    assert overlap(decode(rows, cells)[0, best][None], truth.boxes[0])[0, 0] > 0.9


def red_box(image):
    """Outer edges of what is painted red."""
    rows, columns = np.nonzero((image[:, :, 2].astype(int) - image[:, :, 0]) > 100)
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])


@pytest.mark.parametrize("seed", range(6))
def test_boxes_follow_what_augmentation_does_to_the_picture(seed):
    generator = np.random.default_rng(seed)
    one = example([(40.0, 30, 90, 70)], [0])
    made = single(one, 128, generator)
    if generator.random() < 0.5:
        made = flip(made)
    np.testing.assert_allclose(made.boxes[0], red_box(made.image), atol=1.5)


@pytest.mark.parametrize("seed", range(6))
def test_a_mosaic_holds_its_parts_where_their_boxes_say(seed):
    """Only the third picture has a box; what the seam cuts off lowers its visible share."""
    generator = np.random.default_rng(seed)
    empty = example([], [])
    made = mosaic([empty, empty, example([(40.0, 30, 90, 70)], [0], [0.8]), empty], 128, generator)
    if len(made.boxes) and (made.boxes[0, 2:] - made.boxes[0, :2]).min() > 3:
        np.testing.assert_allclose(made.boxes[0], red_box(made.image), atol=1.5)
    assert all(0.0 < share <= 0.8 + 1e-6 for share in made.visible)


def test_plain_is_the_letterbox_of_the_robot():
    made = plain(example([(40.0, 30, 90, 70)], [0]), 128)
    assert (made.image[96:] == PAD).all()
    np.testing.assert_array_equal(made.boxes, [[40, 30, 90, 70]])


def test_hidden_and_tiny_boxes_are_ignored_and_not_asked_for():
    made = example([(0.0, 0, 50, 50), (0, 0, 50, 50), (0, 0, 8, 8)], [0, 1, 1], [1.0, 0.2, 1.0])
    _, truth = collate([made, example([], [])])
    assert truth.valid.tolist() == [[True, False, False], [False] * 3]
    assert truth.ignored.tolist() == [[False, True, True], [False] * 3]


@pytest.fixture(scope="module")
def drawn():
    """Red squares are chairs, green ones couches."""
    generator = np.random.default_rng(7)
    made = []
    for number in range(24):
        side = int(generator.integers(24, 60))
        x, y = (int(generator.integers(0, limit - side)) for limit in (64, 64))
        colour = ((0, 0, 255), (0, 255, 0))[number % 2]
        made.append(example([(x, y, x + side, y + side)], [number % 2], size=(64, 64), colour=colour))
    return made


def test_batches_are_the_same_again_from_any_point(drawn):
    batches = Batches(drawn, 64, 4, seed=3, mosaic_share=0.5)
    whole = [images for images, _ in batches.epoch(1)]
    assert len(whole) == 6
    again = [images for images, _ in batches.epoch(1, first=4)]
    assert torch.equal(torch.stack(whole[4:]), torch.stack(again))
    assert not torch.equal(whole[0], next(iter(batches.epoch(2)))[0])


def test_a_batch_that_cannot_be_made_ends_training_with_one_line(drawn):
    class Broken(Batches):
        def _pick(self, epoch, index):
            raise SystemExit(3)

    with pytest.raises(ExportError, match="died"):
        next(iter(Broken(drawn, 64, 4, seed=3, mosaic_share=0.5).epoch(0)))


def test_a_resumed_run_ends_where_an_unbroken_one_does(drawn, tmp_path):
    """Two epochs at once, or one stopped and gone on with: the same weights to the last bit."""
    settings = Settings(size=64, batch=8, epochs=2, rate=1e-3, threads=1)

    def trainer(folder, given=settings):
        return Trainer(begin("none", CLASSES, 64, seed=0), drawn, {"drawn": drawn[:8]}, tmp_path / folder, given)

    whole = trainer("whole")
    whole.run()
    broken = trainer("broken")
    step, steps = broken._step, []

    def stop_after_four(images, targets):
        if len(steps) == 4:
            raise KeyboardInterrupt
        steps.append(step(images, targets))

    broken._step = stop_after_four
    with pytest.raises(KeyboardInterrupt):
        broken.run()
    resumed = trainer("broken")
    resumed.resume()
    assert (resumed.epoch, resumed.index, resumed.steps) == (1, 1, 4)
    resumed.run()
    for name, tensor in whole.average.items():
        assert torch.equal(tensor, resumed.average[name]), name
    assert (tmp_path / "broken/best.pt").stat().st_size < 3_000_000


def test_going_on_from_other_weights_keeps_to_the_start_s_features(drawn, tmp_path):
    """The features are held near the start's, whose own then lie off by as much as the two networks differ."""
    start, other = (begin("none", CLASSES, 64, seed=seed) for seed in (0, 1))
    trainer = Trainer(
        start, drawn, {"drawn": drawn[:8]}, tmp_path, Settings(size=64, keep=1.0, threads=1), other.network
    )
    assert trainer.teacher is start.network
    for name, tensor in other.network.state_dict().items():
        assert torch.equal(trainer.network.state_dict()[name], tensor), name
    picture = torch.rand(1, 3, 64, 64) * 255.0
    with torch.no_grad():
        x4 = trainer.network.early(picture)
        assert float(trainer._drift(x4, picture, trainer.network.late(x4))) > 0.01


def test_pictures_are_read_once_at_the_network_s_size(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "labels").mkdir()
    cv2.imwrite(str(tmp_path / "images/a.png"), np.zeros((120, 160, 3), np.uint8))
    (tmp_path / "labels/a.txt").write_text("56 0.5 0.5 0.25 0.5\n0 0.5 0.5 0.1 0.1\n")
    (found,) = load_examples([f"yolo:{tmp_path}"], CLASSES, 64)
    assert found.image.shape == (48, 64, 3)
    np.testing.assert_allclose(found.boxes, [[24, 12, 40, 36]], atol=1e-4)
    assert found.labels.tolist() == [0]
    assert found.unasked is not None
    assert not found.unasked.any()


def test_rare_classes_come_more_often_into_mosaics():
    """Of 100 pictures all show a chair, 3 a couch: sqrt(0.3 / 0.03) = 3.16; hidden ones do not count."""
    box = (0.0, 0, 50, 50)
    common, rare = example([box], [0]), example([box, box], [0, 1])
    hidden = example([box, box], [0, 1], [1.0, 0.1])
    factors = rarity([common] * 96 + [rare] * 3 + [hidden])
    assert factors[:96].tolist() == [1.0] * 96
    assert factors[96:].tolist() == pytest.approx([10**0.5] * 3 + [1.0])


def test_a_blend_lies_between_and_is_refused_across_layers(drawn):
    start, tuned = (begin("none", CLASSES, 64, seed=seed).network for seed in (0, 1))
    middle = blend(start, tuned, 0.25)
    for name, tensor in middle.state_dict().items():
        if tensor.is_floating_point():
            expected = 0.75 * start.state_dict()[name] + 0.25 * tuned.state_dict()[name]
            torch.testing.assert_close(tensor, expected, msg=name)
    with pytest.raises(ExportError, match="do not blend"):
        blend(start, Nano(2, norm=False), 0.5)


def test_the_blend_nearest_to_the_start_within_the_loss_is_chosen(drawn, monkeypatch):
    """AP50 falls 0.80, 0.79, 0.76, ...: a loss of 0.03 allows 95 % but not 90 %."""
    from edgemap.export.detector import blend as module

    figures = iter((0.80, 0.79, 0.76, 0.1, 0.0))
    monkeypatch.setattr(module, "validate", lambda *_: {"ap50": next(figures), "ap": 0.5})
    start = begin("none", CLASSES, 64, seed=0)
    chosen, rows = choose_blend(start.network, begin("none", CLASSES, 64, seed=1), {"drawn": drawn}, 0.03)
    assert [row["share"] for row in rows] == [1.0, 0.95, 0.9]
    assert [row["share"] for row in chosen.measured["blend"]] == [1.0, 0.95]
