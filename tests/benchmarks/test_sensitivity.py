from dataclasses import dataclass, field

from edgemap.benchmarks.sensitivity import Sensitivity, numbers_of, scaled, sweep


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


def test_a_number_that_matters_shows_in_mean_and_lowest():
    """Two maps: 0.1 gain, and 0.3. By hand: halving 2 takes 0.1 of the first; the second stays."""
    rows = list(sweep(Tree(), ["part"], lambda tree: [0.1 * tree.part.gain, 0.3]))
    assert rows[0] == Sensitivity("part.gain", 0.5, -0.05, -0.1)
    assert rows[1] == Sensitivity("part.gain", 2.0, 0.1, 0.1)
    assert [(row.field, row.mean, row.lowest) for row in rows[2:]] == [("part.count", 0.0, 0.0)] * 2
