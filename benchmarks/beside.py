"""This build beside another commit, in turn in one run: `python -m edgemap.benchmarks.beside COMMIT`.

Every round runs the `edgemap bench` of both trees, so that what else the machine does meets both; figures are medians
over the rounds. The other build needs the packages of this environment and its commit in this repository.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

# An editable install would answer for modules that a tree does not have.
START = """
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in getattr(finder, "__module__", "")]
from edgemap.cli import main
main()
"""


def package_of(root: Path, folder: Path) -> Path:
    """A folder for PYTHONPATH with the package `edgemap` of a tree, by links."""
    package = folder / "edgemap"
    package.mkdir(parents=True)
    for part in (*filter(Path.is_dir, root.iterdir()), *(root / "api").glob("*.py")):
        (package / part.name).symlink_to(part)
    return folder


def bench(package: Path, options: list[str]) -> dict[str, dict[str, float]]:
    """Figures of the step by rate, of one `edgemap bench`. Ends the program where that fails."""
    command = [sys.executable, "-c", START, "bench", "--json", *options]
    environment = {"PYTHONPATH": str(package), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        sys.exit(f"{package.name} build: {done.stderr.strip()}")
    return {
        rate: {key: leg[key] for key in ("cpu_ms_per_frame", "cpu_percent", "fps")}
        | {f"{share}_ms": leg["latency_ms"][share] for share in ("p50", "p99")}
        for rate, leg in json.loads(done.stdout)["paced"].items()
    }


def beside(packages: list[Path], options: list[str], rounds: int) -> dict[str, Any]:
    """Both builds' figures by rate, and their ratios this / other."""
    found: dict[str, list[dict[str, dict[str, float]]]] = {package.name: [] for package in packages}
    for number in range(rounds):
        for package in packages[:: 1 if number % 2 else -1]:
            found[package.name].append(bench(package, options))
    document: dict[str, Any] = {}
    for rate, first in found["this"][0].items():
        figures = {
            name: {key: round(float(np.median([row[rate][key] for row in rows])), 2) for key in first}
            for name, rows in found.items()
        }
        ratios = {f"{key}_ratio": round(figures["this"][key] / figures["other"][key], 3) for key in first}
        document[rate] = figures | ratios
    return document


def main() -> None:
    """Check the commit out into a temporary worktree, measure, print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0], epilog="Others: as of edgemap bench")
    parser.add_argument("commit")
    parser.add_argument("--rounds", type=int, default=5)
    given, options = parser.parse_known_args()
    repository = Path(__file__).resolve().parents[1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        there = folder / "tree"
        subprocess.run(["git", "-C", repository, "worktree", "add", "-q", "--detach", there, given.commit], check=True)
        try:
            packages = [package_of(root, folder / one) for one, root in (("this", repository), ("other", there))]
            print(json.dumps(beside(packages, options, given.rounds), indent=1))
        finally:
            subprocess.run(["git", "-C", repository, "worktree", "remove", "--force", there], check=True)


if __name__ == "__main__":
    main()
