import numpy as np
import pytest

from edgemap.evaluation.detection import (
    EvaluationError,
    ScoredPicture,
    average_precision,
    break_even_scores,
    match_boxes,
    operating_point,
)
from edgemap.geometry.observations.detections import Detections

NAMES = ("chair", "couch")
TRUE = np.array([[10.0, 10.0, 50.0, 50.0], [60.0, 60.0, 90.0, 90.0]])


def picture(boxes, labels, scores, true=TRUE, true_labels=(0, 0)):
    return ScoredPicture(
        100,
        100,
        true,
        np.array(true_labels),
        np.array(boxes, float).reshape(-1, 4),
        np.array(labels, int),
        np.array(scores),
    )


def test_perfect_boxes_score_one():
    figures = average_precision([picture(TRUE, [0, 0], [0.9, 0.8])], NAMES)
    assert (figures["ap"], figures["ap50"]) == (1.0, 1.0)
    assert list(figures["per_class"]) == ["chair"]


def test_one_of_two_found_is_half_the_recall():
    """Precision 1 up to recall 0.5: 51 of COCO's 101 recall points."""
    figures = average_precision([picture(TRUE[:1], [0], [0.9])], NAMES)
    assert figures["ap50"] == pytest.approx(51 / 101, abs=1e-6)


def test_a_false_box_ranked_first_halves_precision():
    """Ranked first, one miss: precisions 1/2 and 2/3, interpolated to 2/3 over the whole curve."""
    figures = average_precision([picture([[0, 0, 5, 5], *TRUE], [0, 0, 0], [0.99, 0.9, 0.8])], NAMES)
    assert figures["ap50"] == pytest.approx(2 / 3, abs=1e-6)


def test_a_box_of_iou_two_thirds_counts_up_to_that_threshold():
    """Shifted by a fifth of its side: IoU 32/48 = 0.667, found at 0.50, 0.55, 0.60 and 0.65 only."""
    shifted = [[18.0, 10.0, 58.0, 50.0]]
    figures = average_precision([picture(shifted, [0], [0.9], TRUE[:1], (0,))], NAMES)
    assert (figures["ap50"], figures["ap"]) == (pytest.approx(1.0), pytest.approx(0.4))


def test_the_right_box_with_the_wrong_label_is_a_miss():
    assert average_precision([picture(TRUE, [1, 1], [0.9, 0.8])], NAMES)["ap50"] == 0.0


def test_nothing_found_is_zero_and_nothing_true_is_an_error():
    assert average_precision([picture([], [], [])], NAMES)["ap"] == 0.0
    with pytest.raises(EvaluationError, match="no true boxes in 1 pictures"):
        average_precision([picture(TRUE, [0, 0], [0.9, 0.8], np.zeros((0, 4)), ())], NAMES)


def test_an_ignored_box_is_neither_hit_nor_miss():
    """Half of the truth is ignored: finding the other half is perfect, and boxes on the ignored one cost nothing."""
    half = np.array([False, True])
    one = ScoredPicture(100, 100, TRUE, np.array([0, 0]), TRUE[:1], np.array([0]), np.array([0.5]), half)
    both = ScoredPicture(100, 100, TRUE, np.array([0, 0]), TRUE[::-1], np.array([0, 0]), np.array([0.9, 0.5]), half)
    for case in (one, both):
        figures = average_precision([case], NAMES)
        assert (figures["ap50"], figures["boxes_true"], figures["boxes_ignored"]) == (1.0, 1, 1)
    nobody = ScoredPicture(100, 100, TRUE, np.array([0, 0]), TRUE, np.array([0, 0]), np.array([0.9, 0.5]), ~half | half)
    with pytest.raises(EvaluationError, match="no true boxes"):
        average_precision([nobody], NAMES)


def test_only_classes_that_are_asked_for_are_compared():
    """Of two true boxes and two found ones, the chair of each; the ignored mark goes along."""
    found = Detections(TRUE, np.array([0.9, 0.8]), np.array([1, 0]), NAMES)
    one = ScoredPicture.compare((100, 80), TRUE, ("lamp", "chair"), np.array([False, True]), found, {"chair": 0})
    assert (one.width, one.height) == (100, 80)
    np.testing.assert_array_equal(one.true_boxes, TRUE[1:])
    np.testing.assert_array_equal(one.boxes, TRUE[1:])
    assert (one.true_labels.tolist(), one.labels.tolist(), one.scores.tolist()) == ([0], [0], [0.8])
    assert one.ignored is not None
    assert one.ignored.tolist() == [True]


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


def test_a_box_inside_an_ignored_one_is_neither_right_nor_wrong():
    seen = ScoredPicture(
        100, 100, TRUE, np.array([0, 0]), np.array([[60.0, 60, 80, 80]]), np.array([0]), np.array([0.9]),
        np.array([False, True]),
    )  # fmt: skip
    point = operating_point([seen], NAMES)
    assert (point["precision"], point["recall"]) == (None, 0.0)


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


def test_calibrating_on_pictures_without_boxes_is_an_error():
    with pytest.raises(EvaluationError, match="nothing to calibrate"):
        break_even_scores([picture([], [], [])], NAMES)
