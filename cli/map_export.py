"""`edgemap map export`: a map in another program's format."""

from collections.abc import Sized
from pathlib import Path
from typing import Annotated, Literal

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import above_zero, listed
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.step.map_store import saved_map

NAMES = {
    "geojson": "map.geojson", "nav2": "map.yaml", "nav2-vector": "vector_objects.yaml", "csv": "map.csv",
    "nav2-masks": "zones.yaml", "png": "map.png", "svg": "map.svg", "route": "route.geojson",
}  # fmt: skip


def command(
    map: Annotated[tyro.conf.Positional[Path], arg(metavar="MAP", help="A map.json or a run folder.")],
    *,
    format: Annotated[
        Literal["geojson", "nav2", "nav2-vector", "nav2-masks", "route", "csv", "png", "svg"],
        arg(
            help="geojson: circles as polygons, metres of the map frame; nav2: occupancy map, PGM and YAML; "
            "nav2-vector: circles and zones for Nav2's Vector Object server; nav2-masks: zones for Nav2's keep-out and "
            "speed filters; route: a graph of rooms and doors for Nav2's route server; csv: one line per object; "
            "png, svg: drawn."
        ),
    ],
    out: Annotated[
        Path | None,
        arg(aliases=["-o"], metavar="PATH", help="File or folder to write; beside the map by default."),
    ] = None,
    resolution: Annotated[
        float | None, arg(metavar="M", help="nav2, of a map without a grid: side of a cell, metres; 0.05.")
    ] = None,
    robot_width: Annotated[
        float,
        arg(metavar="M", help="nav2: width of the robot's path that counts as free; route: of the robot; metres."),
    ] = 0.35,
    objects: Annotated[
        bool, arg(help="nav2, of a map with a grid: lay the objects' circles over it as obstacles.")
    ] = False,
    keep_out: Annotated[
        str | None,
        arg(metavar="ZONE,…", help="nav2-masks, nav2-vector: zones, by name or id, where the robot must not go."),
    ] = None,
    speed: Annotated[
        str | None,
        arg(metavar="ZONE=PERCENT,…", help="nav2-masks: of its highest speed, how fast it may be in a zone."),
    ] = None,
    map_id: Annotated[
        str | None,
        arg(metavar="NAME", help="In place of the map's own id, from which and their ids objects have their UUIDs."),
    ] = None,
) -> None:
    """Write a map for another program.

    Objects are circles of their class's usual floor area (the way they face is not known). Where a run folder holds
    trajectory.tum, the robot's path is a line in geojson, png and svg. In nav2 a map with a grid is that grid: seen
    floor, what it meets, unknown; of one without, the robot's path is free, objects are occupied, and the rest is
    unknown. All coordinates are metres in the map frame: x forward, y left at the start.
    """
    from edgemap.geometry.objects.rooms import rooms_of
    from edgemap.runtime.frames.trajectory import trajectory_of
    from edgemap.runtime.step.grid_file import load_grid
    from edgemap.runtime.step.map_file import load_annotated_map

    above_zero(resolution=resolution, robot_width=robot_width)
    if keep_out is not None and format not in ("nav2-masks", "nav2-vector"):
        raise UsageError(f"--keep-out is for --format nav2-masks and nav2-vector, not {format}")
    if speed is not None and format != "nav2-masks":
        raise UsageError(f"--speed is for --format nav2-masks, not {format}")
    map = saved_map(map)
    (mapped, annotations), trajectory, floor = load_annotated_map(map), trajectory_of(map), load_grid(map)
    map_id = map_id or (annotations.identity.map_id if annotations.identity else "map")
    if resolution is not None and floor is not None and format == "nav2":
        raise UsageError(f"--resolution: the map has a grid, which is written as it is: cells of {floor.cell_m:g} m")
    path, cell_m = _target(map, format, out), resolution or 0.05
    written, what = [path], f"{len(mapped)} objects"
    if format == "nav2":
        from edgemap.runtime.outputs.map_formats.grid import grid_of
        from edgemap.runtime.outputs.map_formats.nav2 import write_nav2

        if floor is None:
            grid = grid_of(mapped, trajectory, cell_m, robot_width)
        else:
            grid = grid_of(mapped if objects else (), None, floor.cell_m, observed=floor)
        written = list(write_nav2(path, grid))
        rows, columns = grid.cells.shape
        what = f"occupancy map of {columns} x {rows} cells of {grid.cell_m:g} m, "
        what += f"with {len(mapped)} objects," if floor is None or objects else "without objects (--objects adds them),"
    elif format == "nav2-masks":
        from edgemap.runtime.outputs.map_formats.nav2 import write_masks

        if keep_out is None and speed is None:
            raise UsageError("--format nav2-masks needs --keep-out ZONE,… or --speed ZONE=PERCENT,…")
        written = write_masks(path, annotations.zones, listed(keep_out), _percentages(speed), cell_m)
        what = "masks of zones"
    elif format == "route":
        from edgemap.runtime.outputs.map_formats.route import route_text

        areas = rooms_of(mapped, annotations, floor)
        write_atomically(path, route_text(*areas, floor, robot_width / 2.0))
        what = f"route graph of {_counted(rooms=areas[0], doors=areas[1])}"
    elif format in ("png", "svg"):
        from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, draw_map

        poses = trajectory.poses if trajectory else ()
        areas = rooms_of(mapped, annotations, floor)
        draw_map(path, DrawnMap(mapped, poses, (), (), annotations.zones, floor, *areas))
        what = f"drawing of {len(mapped)} objects"
    elif format == "geojson":
        from edgemap.geometry.grid.walls import walls_of
        from edgemap.runtime.outputs.map_formats.geojson import geojson_text

        walls, areas = walls_of(floor) if floor else (), rooms_of(mapped, annotations, floor)
        write_atomically(path, geojson_text(mapped, trajectory, map_id, annotations, walls, *areas))
        what = _counted(objects=mapped, rooms=areas[0], doors=areas[1], walls=walls, zones=annotations.zones)
    elif format == "csv":
        from edgemap.runtime.outputs.map_formats.table import csv_text

        write_atomically(path, csv_text(mapped, annotations.zones))
    else:
        from edgemap.runtime.outputs.map_formats.nav2 import vector_text

        zones = annotations.zones
        write_atomically(path, vector_text(mapped, map_id, cell_m, zones, listed(keep_out)))
        what = _counted(objects=mapped, zones=zones)
    hint = "" if trajectory or floor else "; no trajectory.tum beside it" if format == "nav2" else ""
    print(f"{what} written to {' and '.join(str(path) for path in written)}{hint}")


def _counted(**parts: Sized) -> str:
    """How many of each, those alone that are there; of the first always."""
    first = next(iter(parts))
    there = {name: len(some) for name, some in parts.items() if some or name == first}
    return ", ".join(f"{count} {name.removesuffix('s') if count == 1 else name}" for name, count in there.items())


def _percentages(text: str | None) -> dict[str, int]:
    """`--speed A=50,B=20`. Raises UsageError."""
    limits = {}
    for part in listed(text):
        name, equals, percent = part.rpartition("=")
        if not equals or not percent.isdecimal() or not 1 <= int(percent) <= 100:
            raise UsageError(f"--speed {part!r}: expected ZONE=PERCENT with 1 to 100")
        limits[name.strip()] = int(percent)
    return limits


def _target(source: Path, kind: str, out: Path | None) -> Path:
    """The file to write; its folder is made. A path without an ending is a folder."""
    folder = source if source.is_dir() else source.parent
    path = out or folder
    if path.is_dir() or not path.suffix:
        path = path / NAMES[kind]
    if kind in ("png", "svg") and path.suffix.lower() != f".{kind}":
        raise UsageError(f"--out {path}: --format {kind} writes files that end in .{kind}")
    if kind == "nav2":
        if path.suffix.lower() not in (".yaml", ".yml", ".pgm"):
            raise UsageError(f"--out {path}: --format nav2 writes NAME.yaml and NAME.pgm")
        path = path.with_suffix(".yml" if path.suffix == ".yml" else ".yaml")
    if path.resolve() == (folder / "map.json").resolve() or path.resolve() == source.resolve():
        raise UsageError(f"--out {path} is the map itself")
    make_folder(path.parent)
    return path
