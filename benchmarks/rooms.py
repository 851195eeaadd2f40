"""`python -m edgemap.benchmarks.rooms --seeds 9100:9110`: maps of simulated homes against the truth, side by side.

Every home is rendered once by `edgemap simulate` (kept, and resumed, in the folder) and mapped by `edgemap eval map`
with both clusterings, from true poses and from the odometry's. Figures are means over the homes; the worst home's F1
stands beside them.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import tyro

FIGURES = ("f1", "precision", "recall", "median_error_m", "covered95")


@dataclass(frozen=True)
class Options:
    """seeds: A:B, homes from A up to, not including, B. light: as of `simulate`, else drawn. out: where drives go."""

    seeds: str = "9100:9110"
    frames: int = 450
    bundle: str = "edgemap-nano"
    odometry: str = "planar"
    light: str | None = None
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/rooms")
    json: bool = False


def main(options: Options) -> None:
    """Render, map, score, and print one table."""
    first, end = (int(part) for part in options.seeds.split(":"))
    rows: list[dict[str, Any]] = []
    for seed in range(first, end):
        drive = options.out / f"{seed}{'' if options.light is None else f'-{options.light}'}"
        light = [] if options.light is None else ["--light", options.light]
        _edgemap("simulate", "--seed", str(seed), "--frames", str(options.frames), *light, "-o", str(drive))
        for clustering in ("default", "paper"):
            found = _edgemap(
                "eval", "map", "--data", f"drive:{drive}", "--bundle", options.bundle, "--odometry", options.odometry,
                "--clustering", clustering, "--json",
            )  # fmt: skip
            rows.append({"seed": seed, **json.loads(found)})
        if not options.json:
            print(_home(rows[-2]), flush=True)
    document = {"bundle": options.bundle, "frames": options.frames, "light": options.light, "homes": rows}
    document["mean"] = {f"{clustering} {poses}": summary(rows, clustering, poses) for clustering, poses in _VARIANTS}
    if options.json:
        print(json.dumps(document, indent=1))
        return
    for name, figures in document["mean"].items():
        told = "  ".join(f"{key} {value:.3f}" for key, value in figures.items())
        print(f"{name:<18} {told}")


_VARIANTS = tuple((clustering, poses) for clustering in ("default", "paper") for poses in ("true", "estimated"))


def summary(rows: list[dict[str, Any]], clustering: str, poses: str) -> dict[str, float]:
    """Means over the homes of one clustering and kind of poses, and the worst home's F1; null figures are left out."""
    chosen = [row[poses] for row in rows if row["clustering"] == clustering]
    means = {key: fmean([own[key] for own in chosen if own[key] is not None] or [0.0]) for key in FIGURES}
    return {**means, "worst_f1": min(own["f1"] or 0.0 for own in chosen)}


def _home(row: dict[str, Any]) -> str:
    true, estimated = row["true"], row["estimated"]
    mount = f"{row['mount']['height_m']:.2f} m {row['mount']['pitch_deg']:.0f} deg"
    return (
        f"{row['seed']}: {row['path_m']:.1f} m, {row['objects_true']} objects, camera {mount}; true poses F1 "
        f"{true['f1']} median {true['median_error_m']} m, {row['odometry']} F1 {estimated['f1']}"
    )


def _edgemap(*arguments: str) -> str:
    """Standard output of one edgemap command; ends this program with the command's own line where it fails."""
    done = subprocess.run([sys.executable, "-m", "edgemap.cli", *arguments], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"edgemap {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
