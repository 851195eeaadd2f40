"""`edgemap map show`: look at a map."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json, last_run, listed, print_json
from edgemap.runtime.frames.errors import OdometryError, UsageError
from edgemap.runtime.frames.option_texts import known_names, numbers
from edgemap.runtime.frames.reading import print_message, printable
from edgemap.runtime.step.map_store import saved_map

if TYPE_CHECKING:
    from edgemap.geometry.grid.rooms import Door, Room
    from edgemap.geometry.map_object import MapObject
    from edgemap.geometry.se2 import SE2
    from edgemap.runtime.outputs.map_formats.drawing import DrawnMap


def command(
    maps: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        arg(metavar="[MAP...]", help="map.json files or run folders; the newest run in runs/ or here by default."),
    ] = (),
    out: Annotated[
        Path | None,
        arg(aliases=["-o"], metavar="PATH", help="Picture to write, .png or .svg; map.png beside the map by default."),
    ] = None,
    label: Annotated[str | None, arg(metavar="A,B,…", help="Only objects of these classes.")] = None,
    near: Annotated[
        str | None, arg(metavar="X,Y", help="Nearest to this point first, with distances; metres, map frame.")
    ] = None,
    inside: Annotated[
        str | None,
        arg(metavar="X,Y;X,Y;…", help="Only objects whose centre lies in this polygon; metres, map frame."),
    ] = None,
    since: Annotated[
        float | None, arg(metavar="S", help="Only objects seen at this stamp or later; the map's seconds.")
    ] = None,
    history: Annotated[
        bool, arg(help="What became of the objects: appeared, moved, vanished, named; by time.")
    ] = False,
    json: Json = False,
) -> None:
    """Draw a map: all sightings, the clusters they form, their centres with 95 % ellipses, and the robot's trajectory.

    A run folder has all three panels; a map.json alone has the centres only. Map frame: x forward (up), y left, m.
    With a question (--label, --near, --inside, --since) or --json it answers in text and draws only where --out is
    given: the centres of the objects asked for.
    """
    from edgemap.geometry.objects.rooms import rooms_of
    from edgemap.runtime.outputs.map_formats.drawing import DrawnMap
    from edgemap.runtime.step.grid_file import load_grid
    from edgemap.runtime.step.map_file import load_annotated_map

    maps = maps or (last_run(),)
    if len(maps) > 1 and (out is not None or json):
        raise UsageError(f"{'--json' if json else '--out'} takes one map, several are drawn and listed one by one")
    asked = any(option is not None for option in (label, near, inside, since))
    for path in (saved_map(one) for one in maps):
        objects, annotations = load_annotated_map(path)
        answers = answers_to(objects, label, near, inside, since)
        if history:
            shown = [item for item, _ in answers] + ([] if asked else list(annotations.vanished))
            _print_history(shown, json)
            continue
        grid = load_grid(path)
        areas, everything = rooms_of(objects, annotations, grid), not (asked or json)
        if json:
            _print_json(path, areas, answers)
        else:
            _print_lines(answers)
        if everything:
            _print_rooms(areas)
        drawn = DrawnMap([item for item, _ in answers], (), (), (), annotations.zones, grid, *areas)
        picture = _draw(path, drawn, out, everything) if out or everything else None
        if not json:
            count = f"{len(objects)} objects" if everything else f"{len(answers)} of {len(objects)} objects"
            print(count + (f"; drawn in {picture}" if picture else ""))


Areas = tuple[tuple["Room", ...], tuple["Door", ...]]
Answers = list[tuple["MapObject", "float | None"]]


def answers_to(
    objects: "list[MapObject]", label: str | None, near: str | None, inside: str | None, since_s: float | None
) -> Answers:
    """The objects asked for, with their distance in metres where a point is given. Raises UsageError."""
    from edgemap.geometry.objects import queries

    if label is not None:
        labels, there = listed(label), {item.label for item in objects}
        if not labels:
            raise UsageError("--label is empty")
        unknown = [name for name in labels if name not in there]
        if unknown and (hint := known_names(unknown, there, "")).startswith("did you mean"):
            raise UsageError(f"--label {', '.join(unknown)}: not on the map; {hint}")
        objects = [item for item in objects if item.label in labels]
    if inside is not None:
        corners_m = [numbers(corner, "--inside", "X,Y") for corner in inside.split(";") if corner.strip()]
        if len(corners_m) < 3:
            raise UsageError(f"--inside {inside!r}: a polygon has three corners or more, X,Y;X,Y;X,Y")
        objects = queries.inside_polygon(objects, corners_m)
    if since_s is not None:
        objects = [item for item in objects if item.last_seen_s >= since_s]
    if near is None:
        return [(item, None) for item in objects]
    return [(item, distance_m) for distance_m, item in queries.nearest(objects, numbers(near, "--near", "X,Y"))]


def _print_lines(answers: Answers) -> None:
    from edgemap.runtime.outputs.verdict.verdict import is_doubtful, sigma_of

    for item, distance_m in answers:
        x_m, y_m = item.position_m
        away = "" if distance_m is None else f"  {distance_m:6.2f} m away"
        seen = f"seen {item.count} times{away}" + ("  doubtful" if is_doubtful(item) else "")
        named = f"  {item.name}" if item.name else ""
        print(printable(f"{item.id:<20} x {x_m:7.2f} m  y {y_m:7.2f} m  +- {sigma_of(item):.2f} m  {seen}{named}"))


def _print_rooms(areas: Areas) -> None:
    for room in areas[0]:
        title = " ".join(word for word in (room.kind, room.name) if word)
        print(printable(f"{room.id:<20} {room.area_m2:5.1f} m2  {title:<12} {', '.join(room.objects)}".rstrip()))
    for door in areas[1]:
        print(f"{door.id:<20} {door.rooms[0]} to {door.rooms[1]}, open with {100.0 * door.open:.0f} %")


def _print_history(objects: "list[MapObject]", as_json: bool) -> None:
    from edgemap.geometry.objects.queries import changes
    from edgemap.runtime.step.map_file import change_record

    records = [change_record(item, event) for item, event in changes(objects)]
    if as_json:
        return print_json({"changes": records})
    for record in records:
        places = [f"{word} x {record[key][0]:.2f} y {record[key][1]:.2f} m" for word, key in _PLACES if key in record]
        name, other = (f"({record[key]})" if record.get(key) else "" for key in ("name", "other"))
        by = "by a person" if record["by"] == "person" else ""
        words = (record["at"] or "time unknown", record["id"], name, record["what"], other, *places, by)
        print(printable("  ".join(word for word in words if word)))
    return None


_PLACES = (("from", "from_m"), ("to", "to_m"))


def _print_json(path: Path, areas: Areas, answers: Answers) -> None:
    """One document like map.json, with `distance_m` where a point was given."""
    from edgemap.runtime.step.map_file import door_record, map_document, room_record

    document = map_document([item for item, _ in answers])
    document |= {"rooms": [room_record(room) for room in areas[0]], "doors": [door_record(door) for door in areas[1]]}
    for record, (_, distance_m) in zip(document["objects"], answers, strict=True):
        if distance_m is not None:
            record["distance_m"] = round(distance_m, 6)
    print_json({"map": str(path)} | document)


def _draw(path: Path, drawn: "DrawnMap", out: Path | None, with_sightings: bool) -> Path:
    """Draws the map, with the run's trajectory where it lies beside it; the picture's path."""
    from edgemap.runtime.outputs.map_formats.drawing import draw_map
    from edgemap.runtime.outputs.sightings_file import read_sightings

    folder = path if path.is_dir() else path.parent
    stem = folder / ("map" if path.is_dir() else path.stem)
    is_run = (folder / "sightings.jsonl").is_file()
    if is_run:
        drawn = replace(drawn, poses=_poses(folder), sightings=read_sightings(folder) if with_sightings else ())
    return draw_map(out or stem.with_suffix(".png"), drawn)


def _poses(folder: Path) -> "tuple[SE2, ...]":
    """The run's trajectory; none where it is missing or empty, and where it is damaged, with a message."""
    from edgemap.runtime.frames.trajectory import trajectory_of

    try:
        trajectory = trajectory_of(folder)
    except OdometryError as error:
        print_message(f"(the trajectory is not drawn: {error})")
        return ()
    return trajectory.poses if trajectory else ()
