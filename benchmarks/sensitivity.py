"""`python -m edgemap.benchmarks.sensitivity DATA... --fields loop_closure association`: which tuned numbers matter.

Each number of those parts of the configuration is halved and doubled, one at a time. The front end runs once per drive;
each map is made again by the back end alone, so parts of the front end show nothing here. A line holds the change of
the mean F1 over drives and pose sources, and of the lowest one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import tyro

if TYPE_CHECKING:
    from edgemap.evaluation.objects import TrueObject
    from edgemap.runtime.step.config import Config
    from edgemap.runtime.step.frame_observations import FrameObservations

FACTORS = (0.5, 2.0)
Tree = TypeVar("Tree")  # a configuration tree


@dataclass(frozen=True)
class SensitivityOptions:
    """data: drives with true poses and objects. fields: parts of the configuration, or single numbers of it. sources:
    odometries, each with the drive's wheels where it has any. frames: the first ones, all by default."""

    data: tyro.conf.Positional[tuple[str, ...]]
    fields: tuple[str, ...] = ("association", "loop_closure")
    sources: tuple[str, ...] = ("truth", "hybrid")
    bundle: str = "edgemap-nano"
    frames: int | None = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """A parameter, a factor on it, and the change of the mean and the lowest F1."""

    field: str
    factor: float
    mean: float
    lowest: float


@dataclass(frozen=True, slots=True)
class _Drive:
    """What the front end makes of a drive, by pose source."""

    observed: list[dict[str, FrameObservations]]
    truth: list[TrueObject]


def numbers_of(tree: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a configuration tree that is not zero, with its dotted name."""
    if not is_dataclass(tree):
        if isinstance(tree, int | float) and not isinstance(tree, bool) and tree:
            yield path, tree
        return
    for item in fields(tree):
        yield from numbers_of(getattr(tree, item.name), f"{path}.{item.name}" if path else item.name)


def scaled(tree: Any, path: str, factor: float) -> Any:
    """The tree with one parameter times a factor; integers are rounded, to at least 1."""
    name, _, rest = path.partition(".")
    before = getattr(tree, name)
    if rest:
        return replace(tree, **{name: scaled(before, rest, factor)})
    return replace(tree, **{name: max(round(before * factor), 1) if isinstance(before, int) else before * factor})


def sweep(config: Tree, wanted: Sequence[str], score: Callable[[Tree], list[float]]) -> Iterator[Sensitivity]:
    """Halves and doubles each selected parameter, relative to the given tree. score: F1 of every map."""
    plain = score(config)
    for field, _ in numbers_of(config):
        if not any(field == part or field.startswith(f"{part}.") for part in wanted):
            continue
        for factor in FACTORS:
            found = score(scaled(config, field, factor))
            mean = (sum(found) - sum(plain)) / len(plain)
            yield Sensitivity(field, factor, round(mean, 4), round(min(found) - min(plain), 4))


def main(options: SensitivityOptions) -> None:
    """Observe every drive once, then print a line for each number and factor."""
    from edgemap.benchmarks.map_variants import Replay, Variant, observed_by, true_objects
    from edgemap.evaluation.objects import score_map
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.config import Config

    bundle, variants = load_bundle(bundle_folder(options.bundle)), {name: Variant(name) for name in options.sources}
    drives = []
    for spec in options.data:
        drive = open_drive(spec)
        observed = list(observed_by(Replay(drive, bundle, options.frames), variants))
        drives.append(_Drive(observed, true_objects(drive, options.frames)))

    def score(config: Config) -> list[float]:
        found = []
        for drive in drives:
            for name, variant in variants.items():
                mapper = variant.mapper(config)
                for frame in drive.observed:
                    mapper.step(frame[name])
                found.append(score_map(mapper.objects(), drive.truth)["f1"] or 0.0)
        return found

    rows = []
    for row in sweep(Config(), options.fields, score):
        rows.append(row)
        if not options.json:
            print(f"{row.field:<44} x{row.factor:<4g} mean {row.mean:+.4f}  lowest {row.lowest:+.4f}", flush=True)
    if options.json:
        print(json.dumps([{item.name: getattr(row, item.name) for item in fields(row)} for row in rows], indent=1))


if __name__ == "__main__":
    main(tyro.cli(SensitivityOptions, description=__doc__))
