"""`python -m edgemap.benchmarks.rooms --seeds 9100:9110`: maps of simulated homes against the truth, side by side.

Every home is rendered once by `edgemap simulate` (kept, and resumed, in the folder), or `--data` names drives that
exist already. Each is mapped by `edgemap eval map` with both clusterings, from true poses and from the odometry's.
Figures are means over the homes, and those of the worst home.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, Literal

import tyro

FIGURES = ("f1", "precision", "recall", "median_error_m", "covered95")
LOW_IS_WORSE = ("f1", "precision", "recall", "covered95")
CLUSTERINGS, POSES = ("default", "paper"), ("true", "estimated")


@dataclass(frozen=True)
class Options:
    """data: drive folders that exist, or folders of them; then nothing is rendered. seeds: A:B, homes from A up to, not
    including, B. light: as of `simulate`, else drawn. out: where rendered drives go."""

    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DIR...")] = ()
    seeds: str = "9100:9110"
    frames: int = 450
    bundle: str = "edgemap-nano"
    odometry: str = "hybrid"
    light: Literal["day", "lamp", "mixed", "dim", "changing"] | None = None
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/rooms")
    json: bool = False


def main(options: Options) -> None:
    """Render where needed, map, score, and print one table."""
    rows: list[dict[str, Any]] = []
    for drive in drives_in(options.data) if options.data else _rendered(options):
        for clustering in CLUSTERINGS:
            found = _edgemap(
                "eval", "map", "--data", f"drive:{drive}", "--frames", str(options.frames), "--bundle", options.bundle,
                "--odometry", options.odometry, "--clustering", clustering, "--json",
            )  # fmt: skip
            rows.append({"home": drive.name, **json.loads(found)})
        if not options.json:
            print(_home(rows[-2]), flush=True)
    variants = [(clustering, poses) for clustering in CLUSTERINGS for poses in POSES]
    if options.json:
        document = {"bundle": options.bundle, "frames": options.frames, "light": options.light, "homes": rows}
        for name, over in (("mean", mean), ("worst", worst)):
            document[name] = {f"{clustering} {poses}": over(rows, clustering, poses) for clustering, poses in variants}
        print(json.dumps(document, indent=1))
        return
    for line in table(rows, options.odometry):
        print(line)


def drives_in(folders: tuple[Path, ...]) -> list[Path]:
    """The drives that these folders are or hold, by name. Ends the program where one holds none."""
    found: list[Path] = []
    for folder in folders:
        own = (
            [folder] if (folder / "objects.json").is_file() else sorted(p.parent for p in folder.glob("*/objects.json"))
        )
        if not own:
            sys.exit(f"{folder}: neither a drive with objects.json nor a folder of such drives")
        found += own
    return found


def table(rows: list[dict[str, Any]], odometry: str) -> list[str]:
    """Means and worst homes of every clustering and kind of poses, a line each."""
    lines = [f"{'':<18} {'':<5} " + " ".join(f"{key:>14}" for key in FIGURES)]
    for clustering in CLUSTERINGS:
        for poses in POSES:
            name = f"{clustering} {'true' if poses == 'true' else odometry}"
            for told, over in (("mean", mean), ("worst", worst)):
                figures = over(rows, clustering, poses)
                lines.append(f"{name:<18} {told:<5} " + " ".join(f"{_number(figures[key]):>14}" for key in FIGURES))
                name = ""
    return lines


def mean(rows: list[dict[str, Any]], clustering: str, poses: str) -> dict[str, float | None]:
    """Means over the homes of one clustering and kind of poses; null figures are left out."""
    return {key: fmean(own) if (own := _known(rows, clustering, poses, key)) else None for key in FIGURES}


def worst(rows: list[dict[str, Any]], clustering: str, poses: str) -> dict[str, float | None]:
    """Every figure's worst home: the least share, the largest error; null figures are left out."""
    extreme = {key: min if key in LOW_IS_WORSE else max for key in FIGURES}
    return {key: extreme[key](_known(rows, clustering, poses, key), default=None) for key in FIGURES}


def _known(rows: list[dict[str, Any]], clustering: str, poses: str, key: str) -> list[float]:
    return [row[poses][key] for row in rows if row["clustering"] == clustering and row[poses][key] is not None]


def _rendered(options: Options) -> Iterator[Path]:
    """Drives through the homes of the seeds, rendered one by one where they are not there yet."""
    first, end = (int(part) for part in options.seeds.split(":"))
    for seed in range(first, end):
        drive = options.out / f"{seed}{'' if options.light is None else f'-{options.light}'}"
        light = [] if options.light is None else ["--light", options.light]
        _edgemap("simulate", "--seed", str(seed), "--frames", str(options.frames), *light, "-o", str(drive))
        yield drive


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _home(row: dict[str, Any]) -> str:
    true, estimated = row["true"], row["estimated"]
    mount = f"{row['mount']['height_m']:.2f} m {row['mount']['pitch_deg']:.0f} deg"
    return (
        f"{row['home']}: {row['path_m']:.1f} m, {row['objects_true']} objects, camera {mount}; true poses F1 "
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
