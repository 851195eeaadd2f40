"""`edgemap run --map MAP [--start X,Y,YAW_DEG|dock|last]`: continuing a saved map, or one that lives over runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import degrees, radians
from pathlib import Path

from edgemap.cli.arguments import OptionError
from edgemap.cli.options import numbers
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.se2 import SE2
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, load_last_pose
from edgemap.runtime.step.map_store import MapPlace
from edgemap.runtime.step.mapper import Mapper


def enter_saved_map(mapper: Mapper, place: MapPlace | None, start: str | None, clustering: str) -> None:
    """Have the mapper continue a map, where one is given. Raises OptionError or MapError."""
    if place is None:
        if start is not None:
            raise OptionError(f"--start {start}: a start pose is one in a saved map, give that with --map")
        return
    if clustering == "paper":
        raise OptionError("--map goes on by association: the paper's clustering needs every sighting, not their map")
    if place.lives and not place.exists:
        if start is not None:
            raise OptionError(f"--start {start}: {place.path} is a new map, whose first pose is its origin")
        print(f"new map: {place.path}/", flush=True)
        return
    (objects, annotations), grid = load_annotated_map(place.path), load_grid(place.path)
    last = load_last_pose(place.path)
    if start is not None:
        mapper.start_in(objects, _start_pose(start, annotations, last), annotations=annotations, grid=grid)
    else:
        mapper.continue_map(objects, annotations, grid, last)


def _start_pose(start: str, annotations: Annotations, last: SE2 | None) -> SE2:
    """The pose that `--start` means. Raises OptionError."""
    starts = {"dock": annotations.dock, "last": last}
    if start not in starts:
        x_m, y_m, yaw_deg = numbers(start, "--start", "X,Y,YAW_DEG")
        return SE2(x_m, y_m, radians(yaw_deg))
    pose = starts[start]
    if pose is None:
        lacks = {"dock": "dock (set it on the live page or with PUT /api/dock)", "last": "last pose"}[start]
        raise OptionError(f"--start {start}: the map has no {lacks}")
    return pose


@contextmanager
def living_map(place: MapPlace | None, mapper: Mapper) -> Iterator[list[LivingMap]]:
    """The sink that saves a map that lives back, while the block lasts. Raises DiskError or RunFolderError."""
    if place is None or not place.lives:
        yield []
        return

    sink = LivingMap(place.path, lambda: mapper.searching)
    try:
        yield [sink]
    finally:
        sink.release()


def where_it_was(mapper: Mapper, saved: Path | None) -> str | None:
    """Result of the relocalisation in the saved map, in one line; None where there was none."""
    search = mapper.relocaliser
    if search is None:
        return None
    if search.alignment is None:
        return f"not found in {saved}, so this run's map stands alone in its own frame: {search.reason}"
    pose, count = search.alignment.pose_a_b, len(search.alignment.pairs)
    how = f"{count} objects" if count else "a pose that was set"
    return (
        f"found in {saved} by {how}: the start was at x {pose.x_m:.2f} m, "
        f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg"
    )
