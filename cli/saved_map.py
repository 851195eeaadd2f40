"""`edgemap run --map MAP [--start X,Y,YAW_DEG|dock|last]`: continuing a saved map, or one that lives over runs."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import degrees
from pathlib import Path

from edgemap.cli.named_maps import FoundMap, PlaceFinder
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.map_store import MapPlace
from edgemap.runtime.step.mapper import Mapper


@contextmanager
def living_map(
    place: MapPlace | None, mapper: Mapper, verdict: Callable[[], Verdict], finder: PlaceFinder | None = None
) -> Iterator[Sequence[LivingMap | FoundMap]]:
    """The sink that saves a map that lives back, while the block lasts. finder: of the place of `--map auto`. Raises
    DiskError or RunFolderError."""
    if finder is not None:
        found = FoundMap(lambda: finder.path, verdict)
        try:
            yield [found]
        finally:
            found.release()
        return
    if place is None or not place.lives:
        yield []
        return

    sink = LivingMap(place.path, lambda: mapper.searching, verdict)
    try:
        yield [sink]
    finally:
        sink.release()


def where_it_was(mapper: Mapper, saved: Path | None) -> str | None:
    """Result of the relocalisation in the saved map, in one line; None where there was none."""
    search = mapper.relocaliser
    if search is None:
        return None
    if isinstance(search, PlaceFinder):
        saved = search.path or Path("any named map")
    if search.alignment is None:
        return f"not found in {saved}, so this run's map stands alone in its own frame: {search.reason}"
    pose, count = search.alignment.pose_a_b, len(search.alignment.pairs)
    how = f"{count} objects" if count else "a pose that was set"
    return (
        f"found in {saved} by {how}: the start was at x {pose.x_m:.2f} m, "
        f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg"
    )
