"""`PYTHONPATH=tests python -m reliability [PART...]`: what must hold on a robot that runs for weeks."""

import json
import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

import tyro

from reliability.parts import PARTS, PartReport

RUNS = Path("runs/reliability")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it, before a part imports numpy


@dataclass(frozen=True)
class ReliabilityOptions:
    """Which parts run, and how much of each."""

    parts: Annotated[
        tyro.conf.Positional[tuple[str, ...]],
        tyro.conf.arg(metavar="PART...", help=f"All by default: {'; '.join(f'{k} ({v})' for k, v in PARTS.items())}."),
    ] = ()
    seed: Annotated[int, tyro.conf.arg(help="Draws every fault and every file.")] = 0
    share: Annotated[float, tyro.conf.arg(help="Of each part's full size: 1 for the published figures.")] = 1.0
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], help="For PART.json and what parts leave behind.")] = RUNS


def main(options: ReliabilityOptions) -> None:
    """Run the parts one by one; exit code 1 where one misses its target."""
    failures = []
    for name in options.parts or PARTS:
        if name not in PARTS:
            sys.exit(f"reliability: no part {name!r}; there are: {', '.join(PARTS)}")
        folder = options.out / name
        folder.mkdir(parents=True, exist_ok=True)
        report: PartReport = import_module(f"reliability.{name}").run(options.seed, options.share, folder)
        document = {"seed": options.seed, "share": options.share, "failures": report.failures} | report.figures
        (options.out / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n")
        print(f"\n{name}: {PARTS[name]}\n", *report.table, sep="\n")
        failures += [f"{name}: {failure}" for failure in report.failures]
    print("", *(failures or ["every target holds"]), sep="\n")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main(tyro.cli(ReliabilityOptions, description=__doc__))
