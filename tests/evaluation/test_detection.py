import numpy as np
import pytest

from edgemap.evaluation.detection import (
    Counts,
    EvaluationError,
    ScoredPicture,
    average_precision,
    break_even_scores,
    counts_by_class,
    match_boxes,
    operating_point,
)
from edgemap.geometry.observations.detections import Detections

NAMES = ("chair", "couch")
TRUE = np.array([[10.0, 10.0, 50.0, 50.0], [60.0, 60.0, 90.0, 90.0]])


def picture(boxes, labels, scores, true=TRUE, true_labels=(0, 0), scored=True):
    boxes, scored = np.array(boxes, float).reshape(-1, 4), np.full(len(true), scored)
    return ScoredPicture(true, np.array(true_labels), boxes, np.array(labels, int), np.array(scores), scored)


@pytest.mark.parametrize(
    ("boxes", "labels", "scores", "true", "ap50", "ap"),
    [
        (TRUE, [0, 0], [0.9, 0.8], TRUE, 1.0, 1.0),
        (TRUE[:1], [0], [0.9], TRUE, 51 / 101, None),  # precision 1 up to recall 0.5: 51 of COCO's 101 recall points
        # A false box ranked first, one miss: precisions 1/2 and 2/3, interpolated to 2/3 over the whole curve.
        ([[0, 0, 5, 5], *TRUE], [0, 0, 0], [0.99, 0.9, 0.8], TRUE, 2 / 3, None),
        # Shifted by a fifth of its side: IoU 32/48 = 0.667, found at 0.50, 0.55, 0.60 and 0.65 only.
        ([[18.0, 10.0, 58.0, 50.0]], [0], [0.9], TRUE[:1], 1.0, 0.4),
        (TRUE, [1, 1], [0.9, 0.8], TRUE, 0.0, 0.0),  # the right box with the wrong label
        ([], [], [], TRUE, 0.0, 0.0),
    ],
)
def test_average_precision_by_hand(boxes, labels, scores, true, ap50, ap):
    figures = average_precision([picture(boxes, labels, scores, true, (0,) * len(true))], NAMES)
    assert figures["ap50"] == pytest.approx(ap50, abs=1e-6)
    assert ap is None or figures["ap"] == pytest.approx(ap)
    assert list(figures["per_class"]) == ["chair"]


def test_pictures_without_true_boxes_are_an_error():
    with pytest.raises(EvaluationError, match="no true boxes in 1 pictures"):
        average_precision([picture(TRUE, [0, 0], [0.9, 0.8], np.zeros((0, 4)), ())], NAMES)
    with pytest.raises(EvaluationError, match="nothing to calibrate"):
        break_even_scores([picture([], [], [])], NAMES)


def test_an_ignored_box_is_neither_right_nor_wrong():
    # Half of the truth is ignored: finding the other half is perfect, and boxes on the ignored one cost nothing.
    half = [True, False]
    one, both = (picture(TRUE[:1], [0], [0.5], scored=half), picture(TRUE[::-1], [0, 0], [0.9, 0.5], scored=half))
    for case in (one, both):
        figures = average_precision([case], NAMES)
        assert (figures["ap50"], figures["boxes_true"], figures["boxes_ignored"]) == (1.0, 1, 1)
    with pytest.raises(EvaluationError, match="no true boxes"):
        average_precision([picture(TRUE, [0, 0], [0.9, 0.5], scored=False)], NAMES)
    seen = picture([[60.0, 60, 80, 80]], [0], [0.9], scored=half)
    point = operating_point([seen], NAMES)
    assert (point["precision"], point["recall"]) == (None, 0.0)


def test_only_classes_that_are_asked_for_are_compared():
    """Of two true boxes and two found ones, the chair of each; the ignored mark goes along."""
    found = Detections(TRUE, np.array([0.9, 0.8]), np.array([1, 0]), NAMES)
    one = ScoredPicture.compare(TRUE, ("lamp", "chair"), np.array([False, True]), found, {"chair": 0})
    np.testing.assert_array_equal(one.true_boxes, TRUE[1:])
    np.testing.assert_array_equal(one.boxes, TRUE[1:])
    assert (one.true_labels.tolist(), one.labels.tolist(), one.scores.tolist()) == ([0], [0], [0.8])
    assert one.scored.tolist() == [False]


def test_precision_and_recall_by_hand():
    """Two chairs are true, one is found twice; a couch is made up: 1 hit, 2 false boxes, 1 miss."""
    found = [TRUE[0], TRUE[0] + 2.0, [0.0, 60, 30, 90]]
    point = operating_point([picture(found, [0, 0, 1], [0.7, 0.9, 0.8])], NAMES)
    assert (point["precision"], point["recall"]) == (pytest.approx(1 / 3, abs=1e-6), 0.5)
    assert point["per_class"]["chair"] == {"precision": 0.5, "recall": 0.5}
    assert point["per_class"]["couch"] == {"precision": 0.0, "recall": None}
    matches = match_boxes(picture(found, [0, 0, 1], [0.7, 0.9, 0.8]))
    assert matches.hit.tolist() == [False, True, False]  # the better score took the chair
    assert matches.found.tolist() == [True, False]


def test_mistakes_are_drawn(tmp_path):
    from edgemap.plots.detection import FALSE, MISSED, Mistakes

    cv2 = pytest.importorskip("cv2")
    mistakes = Mistakes(NAMES)
    image = np.full((100, 100, 3), 90, np.uint8)
    mistakes.add(image, picture([TRUE[0], [0.0, 60, 30, 90]], [0, 1], [0.9, 0.8]))
    mistakes.add(image, picture(TRUE, [0, 0], [0.9, 0.8]))  # nothing wrong here
    for path, colour in zip(mistakes.save(tmp_path), (FALSE, MISSED), strict=True):
        drawn = cv2.imread(str(path))
        assert (drawn[:, :240] == colour).all(axis=2).any()
        assert not (drawn[:, 240:] == colour).all(axis=2).any()  # one tile only


def test_a_class_counts_from_where_its_boxes_are_more_often_right_than_wrong():
    """Of 40 chairs those from 0.6 on are right; couches have no truth, so that their one box says little."""
    scores = np.linspace(0.2, 0.98, 40)
    shown = [picture(TRUE[:1] if score >= 0.6 else [[0, 0, 5, 5]], [0], [score], TRUE[:1], (0,)) for score in scores]
    found = break_even_scores([*shown, picture(TRUE[:1], [1], [0.9])], NAMES)
    assert found["chair"] == pytest.approx(0.6, abs=0.01)
    assert found["couch"] == pytest.approx(0.6, abs=0.01)


CHAIR, TABLE = 0, 1


def pictured(true, found, ignored=()):
    """true: (label, box); found: (label, box, score); boxes are (x, y) of a 10x10 square, or xyxy."""

    def xyxy(box):
        return box if len(box) == 4 else (box[0], box[1], box[0] + 10, box[1] + 10)

    def boxes(rows):
        return np.array([xyxy(row[1]) for row in rows], dtype=np.float64).reshape(-1, 4)

    def labels(rows):
        return np.array([row[0] for row in rows], dtype=np.int64)

    mask = np.array([index not in ignored for index in range(len(true))], dtype=bool)
    scores = np.array([row[2] for row in found])
    return ScoredPicture(boxes(true), labels(true), boxes(found), labels(found), scores, mask)


def chairs(*pictures):
    return counts_by_class(pictures).get(CHAIR, Counts())


@pytest.mark.parametrize(
    ("true", "found", "ignored", "counts"),
    [
        (  # a chair where a table stands is none
            [(CHAIR, (0, 0)), (CHAIR, (50, 50)), (TABLE, (80, 80))],
            [(CHAIR, (1, 0), 0.9), (CHAIR, (80, 80), 0.8), (TABLE, (50, 50), 0.7)], (), (2, 1, 1),
        ),
        ([(CHAIR, (0, 0))], [(CHAIR, (2, 0), 0.6), (CHAIR, (0, 0), 0.9)], (), (1, 1, 1)),  # found once
        # (3, 0) overlaps both by half or more; the better one is left to it because the best score takes the other.
        ([(CHAIR, (0, 0)), (CHAIR, (4, 0))], [(CHAIR, (3, 0), 0.9), (CHAIR, (1, 0), 0.8)], (), (2, 2, 0)),
        ([(CHAIR, (0, 0))], [(CHAIR, (4, 0), 0.9)], (), (1, 0, 1)),  # IoU 6/14
        ([(CHAIR, (0, 0))], [(CHAIR, (3, 0), 0.9)], (), (1, 1, 0)),  # IoU 7/13
        # What nobody is asked for is neither found nor false; the second lies in it by a quarter.
        ([(CHAIR, (0, 0, 40, 40))], [(CHAIR, (5, 5), 0.9), (CHAIR, (35, 35), 0.8)], (0,), (0, 0, 1)),
        ([], [], (), (0, 0, 0)),
    ],
)  # fmt: skip
def test_counts_by_hand(true, found, ignored, counts):
    seen = pictured(true, found, ignored)
    assert [chairs(seen)[key] for key in ("true", "found", "false")] == list(counts)
    assert [chairs(seen, seen)[key] for key in ("true", "found", "false")] == [2 * count for count in counts]
    assert not chairs()
