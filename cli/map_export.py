"""`edgemap map export`: a map in another program's format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError

NAMES = {
    "geojson": "map.geojson", "nav2": "map.yaml", "nav2-vector": "vector_objects.yaml", "csv": "map.csv",
    "png": "map.png", "svg": "map.svg",
}  # fmt: skip


def command(
    map: Annotated[tyro.conf.Positional[Path], arg(metavar="MAP", help="A map.json or a run folder.")],
    *,
    format: Annotated[
        Literal["geojson", "nav2", "nav2-vector", "csv", "png", "svg"],
        arg(
            help="geojson: circles as polygons, metres of the map frame; nav2: occupancy map, PGM and YAML; "
            "nav2-vector: circles for Nav2's Vector Object server; csv: one line per object; png, svg: drawn."
        ),
    ],
    out: Annotated[
        Path | None,
        arg(aliases=["-o"], metavar="PATH", help="File or folder to write; beside the map by default."),
    ] = None,
    resolution: Annotated[float, arg(metavar="M", help="nav2: side of a cell, metres.")] = 0.05,
    robot_width: Annotated[
        float, arg(metavar="M", help="nav2: width along the robot's path that counts as free, metres.")
    ] = 0.35,
    map_id: Annotated[
        str,
        arg(metavar="NAME", help="Names the place: objects keep their UUIDs as long as name and id stay."),
    ] = "map",
) -> None:
    """Write a map for another program.

    Objects are circles of their class's usual floor area (the way they face is not known). Where a run folder holds
    trajectory.tum, the robot's path is free floor in nav2, and a line in geojson, png and svg; what was neither driven
    over nor holds an object is unknown. All coordinates are metres in the map frame: x forward, y left at the start.
    """
    from edgemap.runtime.disk import write_atomically
    from edgemap.runtime.map_file import load_annotated_map
    from edgemap.runtime.trajectory import trajectory_of

    for name, value in (("resolution", resolution), ("robot-width", robot_width)):
        if not 0.0 < value < 100.0:
            raise OptionError(f"--{name} {value}: must be above 0 and below 100 m")
    (objects, annotations), trajectory = load_annotated_map(map), trajectory_of(map)
    path = _target(map, format, out)
    written = [path]
    if format == "nav2":
        from edgemap.runtime.mapfiles.grid import GridRule, grid_of
        from edgemap.runtime.mapfiles.nav2 import write_nav2

        grid = grid_of(objects, trajectory, GridRule(resolution, robot_width))
        written = list(write_nav2(path, grid))
    elif format in ("png", "svg"):
        from edgemap.plots.floor_map import plot_map

        plot_map(path, objects, trajectory=trajectory, zones=annotations.zones)
    else:
        from edgemap.runtime.mapfiles.geojson import geojson_text
        from edgemap.runtime.mapfiles.nav2 import vector_text
        from edgemap.runtime.mapfiles.table import csv_text

        if format == "geojson":
            text = geojson_text(objects, trajectory, map_id, annotations.zones)
        else:
            text = csv_text(objects) if format == "csv" else vector_text(objects, map_id, resolution)
        write_atomically(path, text)
    known = "" if trajectory else "; no trajectory.tum beside it" if format == "nav2" else ""
    print(f"{len(objects)} objects written to {' and '.join(str(path) for path in written)}{known}")


def _target(source: Path, kind: str, out: Path | None) -> Path:
    """The file to write; its folder is made. A path without an ending is a folder."""
    folder = source if source.is_dir() else source.parent
    path = out or folder
    if path.is_dir() or not path.suffix:
        path = path / NAMES[kind]
    if kind in ("png", "svg") and path.suffix.lower() != f".{kind}":
        raise OptionError(f"--out {path}: --format {kind} writes files that end in .{kind}")
    if kind == "nav2":
        if path.suffix.lower() not in (".yaml", ".yml", ".pgm"):
            raise OptionError(f"--out {path}: --format nav2 writes NAME.yaml and NAME.pgm")
        path = path.with_suffix(".yml" if path.suffix == ".yml" else ".yaml")
    if path.resolve() == (folder / "map.json").resolve() or path.resolve() == source.resolve():
        raise OptionError(f"--out {path} is the map itself")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(f"{path.parent}: cannot be made ({error.strerror})") from None
    return path
