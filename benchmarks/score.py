"""`python -m edgemap.benchmarks.score MAPS HOMES`: anybody's maps of the benchmark's homes, scored by its protocol.

MAPS: a map.json, a run folder, or a CSV with the columns label, x_m, y_m (others are optional: confidence, and
covariance_xx_m2, covariance_xy_m2, covariance_yy_m2, and width_m, depth_m, yaw_rad of footprints). HOMES: the drive
that it is of, with objects.json. Of many: two folders, where HOME of HOMES goes with HOME/, HOME.json or HOME.csv of
MAPS; a home without a map scores 0. docs/benchmark.md describes the protocol.
"""

import csv
import sys
from dataclasses import replace
from functools import reduce
from json import dumps
from pathlib import Path
from statistics import fmean, stdev
from typing import Annotated, Any

import numpy as np
import tyro

from edgemap.benchmarks.map_variants import plan_figures, true_objects
from edgemap.benchmarks.rooms import drives_in, number, seeds_of
from edgemap.evaluation.footprints import score_footprints
from edgemap.evaluation.objects import score_map
from edgemap.geometry.errors import EdgemapError, MapError
from edgemap.geometry.map_object import MapObject, ObjectFootprint
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, map_path

NEEDED = ("label", "x_m", "y_m")
COVARIANCE = ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2")
FIGURES = ("f1", "precision", "recall", "median_error_m", "p90_error_m")
FOOTPRINT = ("width_m", "depth_m", "yaw_rad")
BY_COVARIANCE = ("covered95", "anees", "ellipse_m2")
# What a line shows besides FIGURES, where the map has it.
PARTS = {
    "footprints": ("footprint", "f1_iou25"),
    "free": ("grid", "free", "precision_10cm"),
    "rooms": ("rooms", "found"),
}


def read_csv(path: Path) -> tuple[list[MapObject], bool]:
    """The objects of a CSV, and whether it states their covariances. Raises MapError with the line for a bad one."""
    objects = []
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader(file)
        columns = rows.fieldnames or ()
        if missing := [name for name in NEEDED if name not in columns]:
            raise MapError(f"{path}: no column {', '.join(missing)}; expected {', '.join(NEEDED)}")
        known = all(name in columns for name in COVARIANCE)
        optional = (*(COVARIANCE if known else ()), *(name for name in ("confidence", *FOOTPRINT) if name in columns))
        for row in rows:
            names = ("x_m", "y_m", *(name for name in optional if row[name]))
            try:
                value = {name: float(row[name]) for name in names}
            except (TypeError, ValueError):
                value = {"": np.nan}
            if not np.isfinite([*value.values()]).all() or not row["label"]:
                raise MapError(f"{path}:{rows.line_num}: expected a label and finite numbers in {', '.join(names)}")
            xx, xy, yy = (value.get(name, 1.0 - (name == COVARIANCE[1])) for name in COVARIANCE)
            covariance, place = np.array([[xx, xy], [xy, yy]]), np.array([value["x_m"], value["y_m"]])
            sides = [value.get(name, 0.5) for name in FOOTPRINT[:2]]
            shape = ObjectFootprint(sides[0], sides[1], value.get("yaw_rad")) if FOOTPRINT[0] in value else None
            number, score = f"{row['label']}-{rows.line_num}", value.get("confidence", 1.0)
            item = MapObject(number, row["label"], place, covariance, sides[0], 0.5, 1, score, 0.0, 0.0)
            objects.append(replace(item, measured=shape))
    return objects, known


def scored_home(found: Path | None, home: Path, frames: int) -> dict[str, Any]:
    """Figures of one home. found: its map, None where there is none. Raises MapError or CameraError."""
    drive, grid, known, annotations = open_drive(f"drive:{home}"), None, True, NO_ANNOTATIONS
    objects: list[MapObject] = []
    if found is not None and found.suffix == ".csv":
        objects, known = read_csv(found)
    elif found is not None:
        (objects, annotations), grid = load_annotated_map(found), load_grid(map_path(found))
    truth = true_objects(drive, frames)
    figures, shapes = score_map(objects, truth), score_footprints(objects, truth)
    row = {"home": home.name, "map": found and str(found)}
    row |= {name: figures[name] for name in (*FIGURES, *(BY_COVARIANCE if known else ()))}
    row |= {"footprint": shapes} if shapes and any(item.measured for item in objects) else {}
    return row if grid is None else row | plan_figures(objects, annotations, grid, drive, frames)


def homes_of(homes: Path, seeds: str) -> list[Path]:
    """A home, or those of a folder. seeds: A:B, or empty for all."""
    found = drives_in((homes,))
    if not seeds:
        return found
    wanted = seeds_of(seeds)
    return [home for home in found if home.name.isdecimal() and int(home.name) in wanted]


def paired(maps: Path, homes: Path, seeds: str = "") -> list[tuple[Path | None, Path]]:
    """Maps with their homes."""
    if (homes / "objects.json").is_file():
        return [(maps, homes)]
    tried = list[tuple[Path | None, Path]]()
    for home in homes_of(homes, seeds):
        names = (home.name, f"{home.name}.json", f"{home.name}.csv")
        tried.append((next((maps / name for name in names if (maps / name).exists()), None), home))
    if not any(found for found, _ in tried):
        raise MapError(f"{maps}: no map of the {len(tried)} homes of {homes}: expected HOME/, HOME.json or HOME.csv")
    return tried


def main(
    maps: tyro.conf.Positional[Path],
    homes: tyro.conf.Positional[Path],
    seeds: str = "",
    frames: int = 600,
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Score, and print a line a home and the mean with its spread. seeds: A:B, of many homes those from A up to, not
    including, B. frames: the drive's first ones, which is as long as the benchmark's are."""
    try:
        rows = [scored_home(found, home, frames) for found, home in paired(maps, homes, seeds)]
    except EdgemapError as error:
        sys.exit(f"score: {error}")
    f1 = [row["f1"] or 0.0 for row in rows]
    total = {"homes": len(rows), "f1": fmean(f1), "f1_spread": stdev(f1) if len(f1) > 1 else None, "f1_worst": min(f1)}
    if json:
        print(dumps({"homes": rows, "total": total}, indent=1))
        return
    for row in rows:
        parts = {name: reduce(lambda part, key: (part or {}).get(key), path, row) for name, path in PARTS.items()}
        shown = {name: row[name] for name in FIGURES} | {
            name: value for name, value in parts.items() if value is not None
        }
        figures = "  ".join(f"{name} {number(value)}" for name, value in shown.items())
        print(f"{row['home']:<12}{figures}{'' if row['map'] else '  no map'}")
    spread = "" if total["f1_spread"] is None else f" +- {total['f1_spread']:.3f}"
    print(f"{len(rows)} homes: F1 {total['f1']:.3f}{spread}, worst {total['f1_worst']:.3f}")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m edgemap.benchmarks.score", description=__doc__)
