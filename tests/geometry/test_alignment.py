import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.rooms import PAIRS, ROOMS, floor, furnished, mapped, somewhere
from support.units import ended

from edgemap.geometry.objects.annotations import NO_ANNOTATIONS
from edgemap.geometry.objects.merge import merge_all
from edgemap.geometry.registration.alignment import AlignmentError, Registration, align
from edgemap.geometry.registration.hypotheses import CHUNK, Motions
from edgemap.geometry.se2 import SE2

MOTIONS = st.builds(SE2, st.floats(-6, 6), st.floats(-6, 6), st.floats(-3.1, 3.1))
SEEDS = st.integers(0, 10_000)
# Seven things, placed by hand, that no turn or shift lays onto itself.
CROOKED = [
    ("chair", 0.0, 0.0), ("chair", 3.0, 0.4), ("couch", 1.0, 2.5), ("bed", 4.5, 3.0), ("tv", -1.0, 1.5),
    ("potted plant", 2.0, -1.8), ("refrigerator", -0.5, 4.0),
]  # fmt: skip


def off_by_m(found: SE2, true: SE2, size_m=6.0) -> float:
    """The farthest that any corner of the room is laid wrongly."""
    corners = true.inverse().apply([[0, 0], [size_m, 0], [0, size_m], [size_m, size_m]])
    return float(np.linalg.norm(found.apply(corners) - true.apply(corners), axis=1).max())


@given(SEEDS, MOTIONS)
def test_a_found_alignment_is_right_whatever_was_missed_or_made_up(seed, motion):
    random = np.random.default_rng(seed)
    room = furnished(random, int(random.integers(6, 20)))
    first, second = (mapped(room, pose, random, sigma_m=0.1, missed=0.2, false=2) for pose in (SE2(), motion))
    try:
        found = align(first, second)
    except AlignmentError:
        assume(False)
    else:
        assert off_by_m(found.pose_a_b, motion) < 0.8


def test_most_rooms_of_twelve_things_are_found_and_no_unrelated_ones():
    random, found, wrong = np.random.default_rng(1), 0, 0
    for _ in range(30):
        room, other = furnished(random, 12), furnished(random, 12)
        motion = somewhere(random)
        drawn = ((room, SE2()), (room, motion), (other, motion))
        first, second, third = (mapped(*each, random, sigma_m=0.1, missed=0.2, false=1) for each in drawn)
        found += _aligns(first, second)
        wrong += _aligns(first, third)
    assert found >= 27
    assert wrong == 0


def _aligns(first, second) -> bool:
    try:
        align(first, second)
    except AlignmentError:
        return False
    return True


def test_the_covariance_tells_how_far_off_it_is():
    random, misses = np.random.default_rng(2), []
    for _ in range(60):
        motion = somewhere(random, 3)
        first, second = (mapped(CROOKED, pose, random, sigma_m=0.05, told_sigma_m=0.05) for pose in (SE2(), motion))
        found = align(first, second)
        miss = found.pose_a_b.vector() - motion.vector()
        miss[2] = math.remainder(miss[2], math.tau)
        misses.append(miss @ np.linalg.solve(found.covariance, miss))
    assert 1.5 < np.mean(misses) < 5.0  # 3 degrees of freedom; the scale for bad fits makes it smaller, never larger


def test_a_mirror_image_is_another_place():
    mirrored = [(label, x, -y) for label, x, y in CROOKED]
    with pytest.raises(AlignmentError, match="explains"):
        align(mapped(CROOKED), mapped(mirrored))


@pytest.mark.parametrize(
    "room",
    [
        [("chair", x, y) for x in (0.0, 2.0) for y in (0.0, 3.0)],  # a half turn
        [("chair", 3 * math.cos(k * math.tau / 6), 3 * math.sin(k * math.tau / 6)) for k in range(6)],
        [("chair", 1.5 * k, 0.0) for k in range(9)] + [("tv", 1.5 * k, 2.0) for k in range(9)],  # rows of desks
    ],
)
def test_a_room_that_looks_the_same_from_elsewhere_is_refused(room):
    with pytest.raises(AlignmentError, match=r"ambiguous|unrelated places"):
        align(mapped(room), mapped(room, SE2(1.0, 2.0, 0.5)))


def test_the_covariance_is_that_of_the_pairs_as_they_lie():
    """Where they lie worse than their maps say, residuals decide: s^2 = sum r^2 / (2 n - 3); yaw has s^2 over the
    pairs' squared distances from their middle."""
    noise = 0.018 * np.sign(np.random.default_rng(4).normal(0.0, 1.0, (7, 2)))
    moved = zip(CROOKED, noise, strict=True)
    first = mapped(CROOKED, told_sigma_m=0.01)
    second = mapped([(label, x + dx, y + dy) for (label, x, y), (dx, dy) in moved], told_sigma_m=0.01)
    found = align(first, second)
    rows_first, rows_second = np.array(found.pairs).T
    places = np.array([item.position_m for item in second])[rows_second]
    residuals = np.array([item.position_m for item in first])[rows_first] - found.pose_a_b.apply(places)
    variance = (residuals**2).sum() / (2 * len(places) - 3)
    assert variance > 1.2 * 2 * 0.01**2  # or this shows nothing
    assert found.covariance[2, 2] == pytest.approx(variance / ((places - places.mean(axis=0)) ** 2).sum(), rel=1e-3)


def test_the_work_comes_in_units_of_bounded_size_and_finds_the_same(monkeypatch):
    random, distances = np.random.default_rng(3), []
    room = furnished(random, 40, (12.0, 9.0), 0.7)
    first, second = (mapped(room, pose, random, sigma_m=0.06, missed=0.1) for pose in (SE2(), SE2(1.0, 2.0, 0.5)))
    apply = Motions.apply

    def counted(motions, points):
        distances.append(len(motions.yaw_rad) * len(first) * len(points))
        return apply(motions, points)

    monkeypatch.setattr(Motions, "apply", counted)
    units: list = []
    found = ended(Registration(first, second).aligning(), units)
    assert len(units) > 20
    assert max(distances) <= CHUNK
    assert found.pairs == align(first, second).pairs


def test_an_alignment_follows_a_map_that_moved_while_it_was_sought():
    found = align(mapped(CROOKED), mapped(CROOKED, SE2(1.0, 2.0, 0.5)))
    now = Registration(mapped(CROOKED), mapped(CROOKED, SE2(1.1, 1.9, 0.55))).realigned(found)
    assert off_by_m(now.pose_a_b, SE2(1.1, 1.9, 0.55)) < 1e-6
    with pytest.raises(AlignmentError):
        Registration(mapped(CROOKED), mapped(CROOKED, SE2(9.0, 2.0, 2.5))).realigned(found)


def test_objects_a_thousand_kilometres_off_with_no_doubt_at_all_are_aligned_or_refused():
    """What a file may say: their information drowns the smallest numbers that are added to it."""
    things = [("tv", 1e6, 1.7586899), ("tv", 1e6, -1.0), ("person", -0.781, 0.18), ("chair", -0.637, -2.4645)]
    doubts = [(2e-9, 2e-9), (1e5, 2e-9), (1e5, 69320.7), (0.98507, 2e-9)]
    objects = [replace(item, covariance_m2=np.diag(doubt)) for item, doubt in zip(mapped(things), doubts, strict=True)]
    try:
        found = align(objects, objects)
    except AlignmentError:
        return
    assert np.isfinite(found.pose_a_b.vector()).all()
    assert (np.linalg.eigvalsh(found.covariance) > 0.0).all()


OTHER = [((0, 0), (3, 4)), ((3, 0), (6.5, 2)), ((-2, 1), (0, 4))]


@pytest.mark.parametrize("motion", [SE2(1.0, -2.0, 0.6), SE2(-3.0, 4.0, 2.8)])
def test_two_objects_and_the_floor_are_enough_and_either_alone_is_not(motion):
    """Two pairs of chair and plant stand equally far apart; a part of the floor rules one of them out."""

    def aligned(first, second):
        return align(mapped(PAIRS), mapped(PAIRS[:2], motion), (first, second))

    whole, part = floor(ROOMS), floor(ROOMS, motion, cut_m=3.7)
    found = aligned(whole, part)
    assert off_by_m(found.pose_a_b, motion) < 0.3
    both = Registration(mapped(PAIRS), mapped(PAIRS[:2], motion), grids=(whole, part))
    assert both.realigned(found).pairs == found.pairs
    itself = align(mapped(PAIRS), mapped(PAIRS), (whole, whole))  # in the middle of the floor's tolerance
    assert off_by_m(itself.pose_a_b, SE2()) < 0.01
    for first, second in ((None, None), (whole, None), (floor(OTHER), part)):
        with pytest.raises(AlignmentError):
            aligned(first, second)
    maps = {"a": (mapped(PAIRS), NO_ANNOTATIONS), "b": (mapped(PAIRS[:2], motion), NO_ANNOTATIONS)}
    merged = merge_all(maps, "a", {"a": whole, "b": part})
    assert (len(merged.objects), merged.refused) == (len(PAIRS), {})
    assert merged.grid is not None
    assert "b" in merge_all(maps, "a").refused
