"""`python -m edgemap.benchmarks.sensitivity DATA... --fields odometry.pictures slam`: which tuned numbers matter.

Each number of those parts of the configuration is halved (and doubled), one at a time, and every drive is followed and
mapped again. The backbone runs once per picture for all of them. Before, the same with other corner counts shows how
far the figures of one run spread by chance: a change within it is none.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import tyro

if TYPE_CHECKING:
    from edgemap.runtime.step.config import Config

SHOWN = ("t_rel_1", "t_rel_5", "nees_5", "tilt", "f1")
CORNERS = (144, 152, 168, 176)
Tree = TypeVar("Tree")  # a configuration tree
Figures = Mapping[str, float | None]


@dataclass(frozen=True)
class SensitivityOptions:
    """data: drives with true poses, a mount and objects. fields: parts of the configuration, or single numbers of it.
    factors: on each number. frames: the first ones, all by default. camera_alone: without wheels, IMU and depth."""

    data: tyro.conf.Positional[tuple[str, ...]]
    fields: tuple[str, ...] = ("odometry.pictures",)
    factors: tuple[float, ...] = (0.5, 2.0)
    frames: int | None = None
    camera_alone: bool = False
    bundle: str = "edgemap-nano"
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """A number of the configuration, a factor on it, and the mean change of each figure over the drives."""

    field: str
    factor: float
    changes: Mapping[str, float]


def numbers_of(tree: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a configuration tree that is not zero, with its dotted name."""
    if not is_dataclass(tree):
        if isinstance(tree, int | float) and not isinstance(tree, bool) and tree:
            yield path, tree
        return
    for item in fields(tree):
        yield from numbers_of(getattr(tree, item.name), f"{path}.{item.name}" if path else item.name)


def scaled(tree: Any, path: str, factor: float) -> Any:
    """The tree with one number times a factor; integers are rounded, to at least 1."""
    name, _, rest = path.partition(".")
    before = getattr(tree, name)
    if rest:
        return replace(tree, **{name: scaled(before, rest, factor)})
    return replace(tree, **{name: max(round(before * factor), 1) if isinstance(before, int) else before * factor})


def sweep(
    config: Tree, wanted: Sequence[str], factors: Sequence[float], score: Callable[[Tree], Sequence[Figures]]
) -> Iterator[Sensitivity]:
    """Each selected number times each factor, relative to the given tree. score: the figures of every drive."""
    plain = score(config)
    for field, _ in numbers_of(config):
        if any(field == part or field.startswith(f"{part}.") for part in wanted):
            for factor in factors:
                yield Sensitivity(field, factor, changes(plain, score(scaled(config, field, factor))))


def changes(before: Sequence[Figures], after: Sequence[Figures]) -> dict[str, float]:
    """Mean change of each figure over the drives that have it."""
    found: dict[str, float] = {}
    for name in SHOWN:
        pairs = [(b.get(name), a.get(name)) for b, a in zip(before, after, strict=True)]
        known = [a - b for b, a in pairs if a is not None and b is not None]
        if known:
            found[name] = sum(known) / len(known)
    return found


def line(row: Sensitivity) -> str:
    """One row of the table: percent, NEES, degrees, F1."""
    return f"{row.field:<44} x{row.factor:<5g} " + "  ".join(f"{k} {v:+.3f}" for k, v in row.changes.items())


def main(options: SensitivityOptions) -> None:
    """Print the spread by chance, then a line for each number and factor."""
    from edgemap.benchmarks.map_variants import remembering
    from edgemap.benchmarks.walks import WalksOptions, walk, with_corners
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.config import Config

    alone = options.camera_alone
    drives = [open_drive(spec) for spec in options.data]
    drives = [replace(drive, depth=()) for drive in drives] if alone else drives
    bundle = remembering(load_bundle(bundle_folder(options.bundle)))
    rules = WalksOptions(options.data, frames=options.frames, without_wheels=alone, without_imu=alone)

    def score(config: "Config") -> list[dict[str, float | None]]:
        return [walk(drive, bundle, config, rules) for drive in drives]

    before = score(Config())
    rows = [Sensitivity("(corners)", count, changes(before, score(with_corners(count)))) for count in CORNERS]
    if not options.json:
        print("\n".join(map(line, rows)), flush=True)
    for row in sweep(Config(), options.fields, options.factors, score):
        rows.append(row)
        if not options.json:
            print(line(row), flush=True)
    if options.json:
        print(json.dumps([{item.name: getattr(row, item.name) for item in fields(row)} for row in rows], indent=1))


if __name__ == "__main__":
    main(tyro.cli(SensitivityOptions, description=__doc__))
