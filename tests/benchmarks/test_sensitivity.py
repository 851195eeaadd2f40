from dataclasses import dataclass, field

import numpy as np

from edgemap.benchmarks.sensitivity import changes, numbers_of, scaled, sweep


@dataclass(frozen=True)
class Part:
    """A part of a toy tree."""

    gain: float = 2.0
    count: int = 1
    on: bool = True


@dataclass(frozen=True)
class Tree:
    """A toy tree."""

    part: Part = field(default_factory=Part)
    zero: float = 0.0
    other: float = 3.0


def test_every_number_but_switches_and_zeros_has_a_name():
    assert list(numbers_of(Tree())) == [("part.gain", 2.0), ("part.count", 1), ("other", 3.0)]


def test_one_number_is_scaled_and_a_count_stays_at_least_one():
    assert scaled(Tree(), "part.gain", 0.5) == Tree(Part(gain=1.0))
    assert scaled(Tree(), "part.count", 0.5) == Tree()
    assert scaled(Tree(), "part.count", 2.0) == Tree(Part(count=2))


def test_a_number_that_matters_shows_in_the_mean_over_the_drives():
    """Two drives: halving 2 takes 0.1 of the first one's F1, the second stays; by hand -0.05 on the mean."""
    rows = list(sweep(Tree(), ["part"], (0.5, 2.0), lambda tree: [{"f1": 0.1 * tree.part.gain}, {"f1": 0.3}]))
    assert [(row.field, row.factor) for row in rows] == [
        ("part.gain", 0.5), ("part.gain", 2.0), ("part.count", 0.5), ("part.count", 2.0),
    ]  # fmt: skip
    np.testing.assert_allclose([row.changes["f1"] for row in rows], [-0.05, 0.1, 0.0, 0.0], atol=1e-12)


def test_a_figure_that_a_drive_lacks_does_not_count():
    assert changes([{"f1": None, "tilt": 1.0}, {"f1": 0.5}], [{"f1": 0.4, "tilt": None}, {"f1": 0.7}]) == {
        "f1": 0.7 - 0.5
    }
