"""`python -m edgemap.benchmarks.rooms --seeds 9100:9110`: maps of simulated homes against the truth, side by side.

Every home is rendered once by `edgemap simulate` (kept, and resumed, in the folder), or `--data` names drives that
exist already. Each is mapped from true poses, from the hybrid with and without wheels, both without loop closure too,
and with the paper's clustering. Figures are means over the homes, and those of the worst home. `--frozen` takes the
homes that decide nothing, 9290-9299 with 600 pictures, and refuses any whose truth is not the one that was committed.
"""

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from json import dumps, loads
from math import degrees
from pathlib import Path
from statistics import fmean, median
from typing import Annotated, Any

import tyro

from edgemap.benchmarks.map_variants import plan_figures, replayed, true_objects
from edgemap.benchmarks.walks import summary
from edgemap.evaluation.footprints import score_footprints
from edgemap.evaluation.objects import score_map, scored
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.store import RENDERED, bundle_folder
from edgemap.runtime.step.slam import SlamOptions

FIGURES = ("f1", "precision", "recall", "median_error_m", "covered95", "anees", "ellipse_m2")
AREAS = {
    "rooms_found": ("rooms", "found"),
    "rooms_iou": ("rooms", "mean_iou"),
    "doors_precision": ("doors", "precision"),
    "doors_recall": ("doors", "recall"),
}
FOOTPRINT = ("f1_iou25", "mean_iou", "yaw_error_deg")
COLUMNS = (*FIGURES, *AREAS, *FOOTPRINT)
VARIANTS = {
    "true poses": SlamOptions("truth", loop_closure=False),
    "with wheels": SlamOptions(),
    "without wheels": SlamOptions(wheels=False),
    "with wheels, no closure": SlamOptions(loop_closure=False),
    "without wheels, no closure": SlamOptions(wheels=False, loop_closure=False),
    "paper, true poses": SlamOptions("truth", loop_closure=False, clustering="paper"),
    "paper, with wheels": SlamOptions(loop_closure=False, clustering="paper"),
}
CLOSURES = (("with wheels", "with wheels, no closure"), ("without wheels", "without wheels, no closure"))
FROZEN_SEEDS, FROZEN_FRAMES = "9290:9300", 600
SUMS = Path(__file__).with_name("frozen.json")


def main(
    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DIR...")] = (),
    seeds: str = "9100:9110",
    frames: int = 450,
    frozen: bool = False,
    bundle: str = "edgemap-nano",
    odometry: str = "hybrid",
    only: tuple[str, ...] = (),
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/rooms"),
    json: bool = False,
) -> None:
    """Render where needed, map, score, and print one table. data: drive folders that exist, or folders of them; then
    nothing is rendered. seeds: A:B, homes from A up to, not including, B. out: where rendered drives go. only: names of
    variants, all by default."""
    if frozen:
        seeds, frames = FROZEN_SEEDS, FROZEN_FRAMES
    if unknown := sorted(set(only) - set(VARIANTS)):
        sys.exit(f"--only {', '.join(unknown)}: expected some of {', '.join(VARIANTS)}")
    variants = {
        name: how if how.odometry == "truth" else replace(how, odometry=odometry)
        for name, how in VARIANTS.items()
        if name in (only or VARIANTS)
    }
    loaded = open_bundle(bundle_folder(bundle), RENDERED, pace="files")
    rows: list[dict[str, Any]] = []
    for folder in drives_in(data) if data else rendered(seeds, frames, out):
        if frozen:
            check_sums(folder)
        rows.append(_scored(folder, loaded, variants, frames))
        if not json:
            print(_home(rows[-1]), flush=True)
    if json:
        document = {"bundle": bundle, "frames": frames, "homes": rows}
        for kind in ("mean", "worst"):
            document[kind] = {variant: over_homes(rows, variant)[kind] for variant in variants}
        document["closure_f1"] = {closed: gains(rows, closed, none) for closed, none in CLOSURES if none in variants}
        print(dumps(document, indent=1))
        return
    for line in table(rows):
        print(line)


def drives_in(folders: tuple[Path, ...]) -> list[Path]:
    """The drives that these folders are or hold, by name. Ends the program where one holds none."""
    found: list[Path] = []
    for folder in folders:
        own = sorted(folder.glob("objects.json")) or sorted(folder.glob("*/objects.json"))
        if not own:
            sys.exit(f"{folder}: neither a drive with objects.json nor a folder of such drives")
        found += [path.parent for path in own]
    return found


def sums_of(folder: Path) -> dict[str, str]:
    """SHA-256 of a drive's truth, by file name."""
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in ("objects.json", "poses.tum")}


def check_sums(folder: Path) -> None:
    """Ends the program where a drive is not the frozen home of its folder's name."""
    known = loads(SUMS.read_text()).get(folder.name)
    if sums_of(folder) != known:
        sys.exit(f"{folder}: objects.json or poses.tum are not those of frozen home {folder.name} ({SUMS.name})")


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Means and worst homes of every variant, a line each, and what loop closure gave at worst."""
    lines = [f"{'':<28} {'':<5} " + " ".join(f"{key:>15}" for key in COLUMNS)]
    for variant in rows[0]["maps"]:
        for kind, figures in over_homes(rows, variant).items():
            name = variant if kind == "mean" else ""
            lines.append(f"{name:<28} {kind:<5} " + " ".join(f"{number(value):>15}" for value in figures.values()))
    for closed, none in CLOSURES:
        if found := gains(rows, closed, none):
            home = min(found, key=lambda name: found[name])
            lines.append(f"loop closure {closed}: F1 {fmean(found.values()):+.3f}, worst {found[home]:+.3f} in {home}")
    return lines


def over_homes(rows: list[dict[str, Any]], variant: str) -> dict[str, dict[str, float | None]]:
    """Means over the homes of one variant, and every figure's worst home."""
    maps = [row["maps"][variant] for row in rows]
    found = summary([dict.fromkeys(FOOTPRINT) | one | one.get("footprint", {}) for one in maps], COLUMNS)
    errors = [error for one in maps for error in one.get("footprint", {}).get("yaw_errors_deg", ())]
    found["mean"]["yaw_error_deg"] = median(errors) if errors else None  # of all objects: a home has a few
    return found


def gains(rows: list[dict[str, Any]], closed: str, none: str) -> dict[str, float]:
    """Gain in F1 by loop closure, per home."""
    both = ((row["home"], *(row["maps"].get(name, {}).get("f1") for name in (closed, none))) for row in rows)
    return {home: round(a - b, 4) for home, a, b in both if a is not None and b is not None}


def _scored(folder: Path, bundle: Bundle, variants: dict[str, SlamOptions], frames: int) -> dict[str, Any]:
    drive = open_drive(f"drive:{folder}")
    truth = true_objects(drive, frames)
    mount, maps = drive.mount, dict[str, dict[str, Any]]()
    for name, slam in replayed(drive, bundle, variants, frames).items():
        objects = slam.objects()
        found = plan_figures(objects, slam.mapper.annotations(), slam.mapper.grid.grid(), drive, frames)
        areas = {key: found.get(kind, {}).get(figure) for key, (kind, figure) in AREAS.items()}
        maps[name] = score_map(objects, truth) | areas
        if footprint := score_footprints(objects, truth):
            maps[name]["footprint"] = footprint
    about = mount and {"height_m": mount.height_m, "pitch_deg": round(degrees(mount.pitch_rad), 3)}
    return {"home": folder.name, "objects_true": len(scored(truth)), "mount": about, "maps": maps}


def seeds_of(text: str) -> range:
    """The seeds A:B, from A up to, not including, B. Ends the program with one line for any other text."""
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal()):
        sys.exit(f"--seeds {text}: expected A:B")
    return range(int(first), int(end))


def rendered(seeds: str, frames: int, out: Path) -> Iterator[Path]:
    """Drives in `out` through the homes of the seeds A:B, rendered one by one where they are missing.

    Ends the program with the command's own line where `edgemap simulate` fails, or the seeds are not A:B.
    """
    for seed in seeds_of(seeds):
        drive, options = out / str(seed), ["--seed", str(seed), "--frames", str(frames)]
        command = [sys.executable, "-m", "edgemap.cli", "simulate", *options, "-o", str(drive)]
        if (done := subprocess.run(command, capture_output=True, text=True)).returncode:
            sys.exit(f"edgemap simulate {' '.join(options)}: {done.stderr.strip()}")
        yield drive


def number(value: float | None) -> str:
    """A figure of a table, or a dash."""
    return "–" if value is None else f"{value:.3f}"


def _home(row: dict[str, Any]) -> str:
    mount = f"{row['mount']['height_m']:.2f} m {row['mount']['pitch_deg']:.0f} deg"
    scores = "  ".join(f"{name} {number(figures['f1'])}" for name, figures in row["maps"].items())
    return f"{row['home']}: {row['objects_true']} objects, camera {mount}; F1 {scores}"


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
