"""Commands behind the figures of README and models/README: `python -m edgemap.benchmarks.figures [NAME...] [--show]`.

Runs each command of figures.txt whose data is on this machine, and writes its output to runs/figures/NAME.txt. Real
data is in $EDGEMAP_SHARED/data (default ../shared), rendered homes in $EDGEMAP_HOMES (default runs/homes). Commands
whose data is absent are printed.
"""

import os
import subprocess
import sys
from pathlib import Path
from string import Template
from typing import Annotated

import tyro

OUT = Path("runs/figures")


def commands() -> dict[str, list[str]]:
    """Each figure's name and the words of its command after `python -m`."""
    text = Path(__file__).with_suffix(".txt").read_text()
    folders = {
        "SHARED": str(Path(os.environ.get("EDGEMAP_SHARED", "../shared")) / "data"),
        "HOMES": os.environ.get("EDGEMAP_HOMES", "runs/homes"),
    }
    lines = (line.split(": ", 1) for line in text.splitlines() if not line.startswith("#"))
    return {name: [Template(word).substitute(folders) for word in command.split()] for name, command in lines}


def main(
    names: tyro.conf.Positional[tuple[str, ...]] = (), show: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
) -> None:
    """names: of figures, all by default. show: print the commands and run none."""
    every = commands()
    if unknown := set(names) - set(every):
        sys.exit(f"figures: {', '.join(sorted(unknown))}: expected some of {', '.join(every)}")
    OUT.mkdir(parents=True, exist_ok=True)
    paths = ["tests", *filter(None, [os.environ.get("PYTHONPATH")])]  # `reliability` is in tests/
    failed, env = [], os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    for name in names or every:
        inputs = [Path(word.partition(":")[2] or word) for word in every[name] if "/" in word]
        absent = next((path for path in inputs if path != OUT and not path.exists()), None)
        print(f"{name}: python -m {' '.join(every[name])}{f'  ({absent} is absent)' if absent else ''}", flush=True)
        if not absent and not show:
            with (OUT / f"{name}.txt").open("w") as file:
                run = subprocess.run(
                    [sys.executable, "-m", *every[name]], env=env, stdout=file, stderr=file, check=False
                )
            failed += [name] * (run.returncode != 0)
    sys.exit(f"figures: failed, see {OUT}: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
