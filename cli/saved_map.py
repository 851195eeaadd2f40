"""`edgemap run --map SAVED [--start X,Y,YAW_DEG]`: going on with a saved map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError
from edgemap.cli.options import numbers

if TYPE_CHECKING:
    from edgemap.runtime.mapper import Mapper

SavedMap = Annotated[
    Path | None,
    arg(
        name="map",
        metavar="SAVED",
        help="Go on with a saved map (map.json or run folder): its objects keep their ids. Where in it the robot is, "
        "is found by its objects once enough of them are seen, or given by --start.",
    ),
]
StartText = Annotated[
    str | None,
    arg(
        metavar="X,Y,YAW_DEG",
        help="Where the robot starts in the saved map, to about 0.1 m and 3 degrees: metres forward and left, degrees "
        "counter-clockwise.",
    ),
]
EditsFile = Annotated[
    Path | None,
    arg(
        name="edits",
        metavar="FILE",
        help="Edits of an earlier run over the same source, taken at the same frames again: its edits.jsonl. A "
        "recording brings those of the run that recorded it.",
    ),
]
Forget = Annotated[
    Literal["auto", "on", "off"],
    arg(
        help="Whether an object that is in plain view and not detected, repeatedly, leaves the map; auto: on with "
        "--map, where furniture may have been moved since."
    ),
]


def forgets(forget: str, saved: Path | None, clustering: str) -> bool:
    """Whether the run weighs negative evidence. Raises OptionError for a map that cannot forget."""
    if forget == "on" and clustering == "paper":
        raise OptionError("--forget on: the paper's clustering keeps every sighting for good")
    return forget == "on" or (forget == "auto" and saved is not None)


def enter_saved_map(mapper: Mapper, saved: Path | None, start: str | None, clustering: str) -> None:
    """Have the mapper go on with a saved map, where one is given. Raises OptionError or MapError."""
    from math import radians

    from edgemap.geometry.se2 import SE2
    from edgemap.runtime.map_file import load_annotated_map

    if saved is None:
        if start is not None:
            raise OptionError(f"--start {start}: a start pose is one in a saved map, give that with --map")
        return
    if clustering == "paper":
        raise OptionError("--map goes on by association: the paper's clustering needs every sighting, not their map")
    objects, annotations = load_annotated_map(saved)
    if start is None:
        mapper.relocalise_in(objects, annotations)
    else:
        x_m, y_m, yaw_deg = numbers(start, "--start", "X,Y,YAW_DEG")
        mapper.start_in(objects, SE2(x_m, y_m, radians(yaw_deg)), annotations=annotations)


def where_it_was(mapper: Mapper, saved: Path | None) -> str | None:
    """How the search for the robot's pose in the saved map ended, in one line; None where there was none."""
    from math import degrees

    search = mapper.relocaliser
    if not search.saved:
        return None
    if search.alignment is None:
        return f"not found in {saved}, so this map stands alone in its own frame: {search.reason}"
    pose = search.alignment.pose_a_b
    return (
        f"found in {saved} by {len(search.alignment.pairs)} objects: the start was at x {pose.x_m:.2f} m, "
        f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg"
    )
