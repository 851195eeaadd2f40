"""The end-to-end fuzzes of tests/fuzz with many more steps than `make test` takes."""

import os
import subprocess
import sys
from pathlib import Path

from reliability.parts import PartReport

STEPS = 100_000
TESTS = Path(__file__).parents[1]


def run(seed: int, share: float, out: Path) -> PartReport:
    """Each of the fuzzes on its own, so that one that fails hides no other. out: their output."""
    steps = {"EDGEMAP_FUZZ_STEPS": str(max(1, round(STEPS * share)))}
    return run_tests(sorted(TESTS.glob("fuzz/test_*.py")), steps, seed, out)


def run_tests(paths: list[Path], sizes: dict[str, str], seed: int, out: Path) -> PartReport:
    """Files of property tests, each in a process of its own. sizes: environment variables. out: their output."""
    failures, figures = [], {}
    for path in paths:
        words = ["-m", "pytest", "-q", "--timeout", "0", f"--hypothesis-seed={seed}", str(path)]
        done = subprocess.run([sys.executable, *words], env=os.environ | sizes, capture_output=True, text=True)
        (out / f"{path.stem}.log").write_text(done.stdout + done.stderr)
        figures[path.stem] = done.stdout.strip().rpartition("\n")[2]
        failures += [f"{path.stem}: {figures[path.stem]}, see {out / path.stem}.log"] * (done.returncode != 0)
    return PartReport(tuple(failures), figures, tuple(f"{name}: {line}" for name, line in figures.items()))
