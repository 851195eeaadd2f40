"""`edgemap map show`: look at a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from edgemap.plots.floor_map import SeenAt
    from edgemap.runtime.trajectory import Trajectory


def command(
    maps: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="MAP...", help="map.json files or run folders.")
    ],
    out: Annotated[
        Path | None,
        tyro.conf.arg(
            aliases=["-o"], metavar="PATH", help="Picture to write, .png or .svg; map.png beside the map by default."
        ),
    ] = None,
) -> None:
    """Draw a map: all sightings, the clusters they form, their centres with 95 % ellipses, and the robot's way.

    A run folder has all three panels; a map.json alone has the centres only. Map frame: x forward (up), y left, m.
    """
    from edgemap.geometry.floor_map import load_map
    from edgemap.plots.floor_map import plot_map

    if not maps or (out is not None and len(maps) > 1):
        from edgemap.cli.options import OptionError

        raise OptionError("no map given" if not maps else "--out takes one map, each of several is drawn beside itself")
    for path in maps:
        objects = load_map(path)
        folder = path if path.is_dir() else path.parent
        is_run = (folder / "sightings.jsonl").is_file()
        way = _way(folder) if is_run else None
        seen = _read_sightings(folder) if is_run else []
        picture = plot_map(out or (folder / f"{'map' if path.is_dir() else path.stem}.png"), objects, seen, way)
        for item in objects:
            sigma_m = float(item.covariance_m2.trace() / 2) ** 0.5
            x_m, y_m = item.position_m
            print(f"{item.id:<20} x {x_m:7.2f} m  y {y_m:7.2f} m  +- {sigma_m:.2f} m  seen {item.count} times")
        print(f"{len(objects)} objects; drawn in {picture}")


def _way(folder: Path) -> Trajectory | None:
    """The run's trajectory; None where it is missing, empty or damaged, which is said."""
    from edgemap.runtime.errors import OdometryError
    from edgemap.runtime.trajectory import parse_tum

    path = folder / "trajectory.tum"
    try:
        return parse_tum(_without_torn_end(path), str(path))
    except OdometryError as error:
        print(f"(the way is not drawn: {error})")
        return None


def _read_sightings(folder: Path) -> list[SeenAt]:
    """The sightings of a run; ids of objects that merged into others count as the one that stayed."""
    import json

    from edgemap.geometry.errors import MapError
    from edgemap.plots.floor_map import SeenAt

    path = folder / "sightings.jsonl"
    try:
        merged = json.loads((folder / "run.json").read_text()).get("merged", {})
    except (OSError, ValueError):
        merged = {}
    found = []
    for number, line in enumerate(_without_torn_end(path).splitlines(), start=1):
        try:
            record = json.loads(line)
            x_m, y_m = record["map_m"]
            found.append(
                SeenAt(record["label"], merged.get(record["object"], record["object"]), float(x_m), float(y_m))
            )
        except (ValueError, KeyError, TypeError):
            raise MapError(f"{path}:{number}: damaged line") from None
    return found


def _without_torn_end(path: Path) -> str:
    """A file's whole lines: what a power cut left of the last one does not count. Raises MapError."""
    from edgemap.geometry.errors import MapError

    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"{path}: cannot be read ({error})") from None
    return text[: text.rfind("\n") + 1]
