import numpy as np

from edgemap.evaluation.detection import Counts, ScoredPicture, counts_by_class

CHAIR, TABLE = 0, 1


def picture(true, found, ignored=()):
    """true: (label, box); found: (label, box, score); boxes are (x, y) of a 10x10 square, or xyxy."""

    def xyxy(box):
        return box if len(box) == 4 else (box[0], box[1], box[0] + 10, box[1] + 10)

    def boxes(rows):
        return np.array([xyxy(row[1]) for row in rows], dtype=np.float64).reshape(-1, 4)

    def labels(rows):
        return np.array([row[0] for row in rows], dtype=np.int64)

    mask = np.array([index in ignored for index in range(len(true))], dtype=bool)
    return ScoredPicture(
        100, 100, boxes(true), labels(true), boxes(found), labels(found), np.array([row[2] for row in found]), mask
    )


def chairs(*pictures):
    return counts_by_class(pictures).get(CHAIR, Counts())


def test_found_false_and_missed():
    seen = picture(
        [(CHAIR, (0, 0)), (CHAIR, (50, 50)), (TABLE, (80, 80))],
        [(CHAIR, (1, 0), 0.9), (CHAIR, (80, 80), 0.8), (TABLE, (50, 50), 0.7)],
    )
    counts = chairs(seen, seen)
    assert counts == Counts(true=4, found=2, false=2)  # a chair where a table stands is none
    assert counts.missed == 2


def test_one_true_box_is_found_once():
    twice = picture([(CHAIR, (0, 0))], [(CHAIR, (2, 0), 0.6), (CHAIR, (0, 0), 0.9)])
    assert chairs(twice) == Counts(true=1, found=1, false=1)


def test_each_detection_takes_the_true_box_that_it_overlaps_most():
    # (3, 0) overlaps both by half or more; the better one is left to it because the best score takes the other.
    pair = picture([(CHAIR, (0, 0)), (CHAIR, (4, 0))], [(CHAIR, (3, 0), 0.9), (CHAIR, (1, 0), 0.8)])
    assert chairs(pair) == Counts(true=2, found=2, false=0)


def test_too_small_an_overlap_is_false_and_missed():
    assert chairs(picture([(CHAIR, (0, 0))], [(CHAIR, (4, 0), 0.9)])) == Counts(1, 0, 1)  # IoU 6/14
    assert chairs(picture([(CHAIR, (0, 0))], [(CHAIR, (3, 0), 0.9)])) == Counts(1, 1, 0)  # IoU 7/13


def test_what_nobody_is_asked_for_is_neither_found_nor_false():
    hidden = picture([(CHAIR, (0, 0, 40, 40))], [(CHAIR, (5, 5), 0.9), (CHAIR, (35, 35), 0.8)], ignored=(0,))
    assert chairs(hidden) == Counts(true=0, found=0, false=1)  # the second lies in it by a quarter


def test_pictures_without_anything_count_nothing():
    assert chairs(picture([], [])) == Counts()
    assert chairs() == Counts()
