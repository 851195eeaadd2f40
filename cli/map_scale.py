"""`edgemap map scale`: scales the map of a camera alone by one measured length."""

import math
from pathlib import Path
from typing import Annotated, Any

import tyro

from edgemap.cli.arguments import arg
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import RunFolderError, UsageError
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M
from edgemap.runtime.step.map_store import saved_map

LARGEST = 3.0  # factor, and its inverse; beyond them a length was probably mistyped


def command(
    map: Annotated[tyro.conf.Positional[Path], arg(metavar="MAP", help="A run folder, or with --between a map.json.")],
    *,
    out: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="Folder that gets map.json, grid and trajectory.")],
    height: Annotated[
        float | None,
        arg(metavar="HEIGHT_M", help="Measured height of the lens above the floor, where the run had another one."),
    ] = None,
    between: Annotated[
        str | None,
        arg(metavar="ID,ID,M", help="Measured distance between the centres of two objects: chair-1,couch-2,2.35."),
    ] = None,
) -> None:
    """Scale the map of a camera alone by one length measured with a tape.

    Without wheels and depth all lengths of a map are proportional to the height of the lens. Objects, floor, zones,
    dock and trajectory are scaled about the map's origin. Where the run can be repeated, a run with the right height
    (run --mount HEIGHT_M) gives a better map.
    """
    from edgemap.geometry.objects.scale import scaled_map
    from edgemap.runtime.frames.trajectory import trajectory_of, tum_line
    from edgemap.runtime.step.grid_file import load_grid
    from edgemap.runtime.step.map_file import load_annotated_map, save_map

    if (height is None) == (between is None):
        raise UsageError("give one length: --height HEIGHT_M or --between ID,ID,M")
    path = saved_map(map)
    objects, annotations = load_annotated_map(path)
    factor = _by_height(path, height) if height is not None else _by_distance(objects, str(between))
    if not 1.0 / LARGEST <= factor <= LARGEST:
        raise UsageError(f"the map would become {factor:.3g} times as large, at most {LARGEST:g}: check the length")
    trajectory, grid = trajectory_of(path), load_grid(path)
    if (out / "run.json").exists() or (out / "map.json").exists() or out.suffix == ".json":
        raise UsageError(f"{out}: --out takes a folder of its own")
    make_folder(out)
    if trajectory is not None:
        poses = zip(trajectory.stamps_s, trajectory.poses, strict=True)
        lines = (tum_line(stamp_s, pose.scaled(factor)) for stamp_s, pose in poses)
        write_atomically(out / "trajectory.tum", "".join(lines))
    save_map(out / "map.json", *scaled_map(objects, annotations, grid, factor))
    print(f"map of {len(objects)} objects, {factor:.3f} times as large, saved in {out / 'map.json'}")


def _by_height(path: Path, height_m: float) -> float:
    """Measured height over that of the run. Raises UsageError where the height is not the scale of the run."""
    from edgemap.cli.run_record import scale_source
    from edgemap.runtime.outputs.verdict.verdict import read_record

    run = path / "run.json" if path.is_dir() else path.with_name("run.json")
    if not run.is_file():
        raise UsageError(f"{path}: --height needs the run's run.json beside the map; else --between ID,ID,M")
    record = read_record(run)
    try:
        before_m = float(record.get("mount_seen", {}).get("used_height_m", record["mount"]["height_m"]))
        measured = scale_source(record)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise RunFolderError(f"{run}: it has no mount") from None
    if measured:
        raise UsageError(f"{path}: {measured} measured this run's path, so its scale is not that of the height")
    if not (LOWEST_M <= height_m <= HIGHEST_M and 0.0 < before_m < math.inf):
        raise UsageError(
            f"--height {height_m:g}: expected {LOWEST_M:g} to {HIGHEST_M:g} m (the run had {before_m:g} m)"
        )
    return height_m / before_m


def _by_distance(objects: list[Any], text: str) -> float:
    """Measured over mapped distance of two objects. Raises UsageError."""
    first, second, length = (part.strip() for part in text.split(",")) if text.count(",") == 2 else ("", "", "")
    by_id = {item.id: item for item in objects}
    try:
        length_m = float(length)
    except ValueError:
        length_m = math.nan
    if not 0.0 < length_m < math.inf:
        raise UsageError(f"--between {text!r}: expected ID,ID,METRES, like chair-1,couch-2,2.35")
    for identity in (first, second):
        if identity not in by_id:
            raise UsageError(f"--between {text!r}: the map has no {identity!r}; edgemap map show lists its objects")
    mapped_m = math.dist(by_id[first].position_m, by_id[second].position_m)
    if mapped_m < 0.5:
        raise UsageError(f"--between {text!r}: they are {mapped_m:.2f} m apart on the map, need 0.5 m or more")
    return length_m / mapped_m
