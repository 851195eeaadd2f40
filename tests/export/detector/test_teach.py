"""Teachers' boxes: averaged over who agrees, halved where one is alone, doubted where they are weak."""

import numpy as np
import pytest

from edgemap.geometry.observations.detections import Detections

pytest.importorskip("torch")

from edgemap.export.detector.loader import Batches
from edgemap.export.detector.store import Example, averaged, load_examples
from edgemap.runtime.inputs.drives.yolo import predicted_boxes

NAMES = ("chair", "couch")


def seen(*rows):
    boxes = np.array([row[2:] for row in rows], np.float64).reshape(-1, 4)
    return Detections(
        boxes, np.array([row[1] for row in rows]), np.array([NAMES.index(row[0]) for row in rows], np.int64), NAMES
    )


def test_boxes_of_two_teachers_by_hand():
    """Chairs at 0.8 and 0.4: 0.6, edges weighted two to one. A lone couch at 0.5 is one of 0.25."""
    one = seen(("chair", 0.8, 0, 0, 30, 30))
    other = seen(("couch", 0.5, 0, 0, 30, 30), ("chair", 0.4, 3, 0, 33, 30))
    boxes, labels, scores = averaged([one, other])
    assert labels == ["chair", "couch"]
    assert scores == pytest.approx([0.6, 0.25])
    np.testing.assert_allclose(boxes, [[1, 0, 31, 30], [0, 0, 30, 30]])


def test_pictures_without_labels_take_the_teachers(tmp_path):
    import cv2

    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((50, 100, 3), number, np.uint8))

    def teach(_image):
        return predicted_boxes(np.array([[10.0, 10, 30, 40], [50, 0, 90, 50]]), NAMES, np.array([0.9, 0.3]))

    examples = load_examples([str(tmp_path)], NAMES, 40, limit=2, teach=teach)
    assert [int(one.image[0, 0, 0]) for one in examples] == [0, 2]
    np.testing.assert_allclose(examples[0].boxes[0], [4.6, 4.6, 13.8, 18.4], atol=1e-5)  # 46 px of 100
    assert examples[0].ignored().tolist() == [False, True]  # what teachers doubt is not asked for
    assert examples[0].complete.all()
    assert examples[0].kept.all()
    (bare, *_) = load_examples([str(tmp_path)], NAMES, 40)
    assert len(bare.boxes) == 0
    assert bare.kept.all()
    assert not bare.complete.any()


def test_a_mix_shows_each_source_by_its_share():
    """Two pictures of one source and eight of another at 3 to 1: of 10, 8 are of the first, evenly."""
    examples = [
        Example(np.full((8, 8, 3), at, np.uint8), np.zeros((0, 4), np.float32), np.zeros(0, np.int64),
                np.zeros(0, np.float32), source=int(at > 1))
        for at in range(10)
    ]  # fmt: skip
    for epoch in range(4):
        order = Batches(examples, 8, 2, 0, 0.0, mix=(0.75, 0.25)).order(epoch)
        counts = np.bincount(order, minlength=10)
        assert counts[:2].tolist() == [4, 4]
        assert counts[2:].sum() == 2
        assert counts[2:].max() == 1
