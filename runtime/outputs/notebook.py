"""Display of results in a notebook: pictures as PNG, maps as a drawing over a table."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from pathlib import Path

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.pose_journal import PoseJournal

MAXIMUM_POSES = 2000  # of a drawn trajectory


class MapObjects(list[MapObject]):
    """A list of objects that a notebook shows as the map from above and a table. trajectory: drawn with them."""

    def __init__(self, objects: Iterable[MapObject] = (), trajectory: PoseJournal | None = None) -> None:
        super().__init__(objects)
        self.trajectory = trajectory

    def _repr_html_(self) -> str:
        return map_html(self, self.trajectory)


def map_html(objects: list[MapObject], trajectory: PoseJournal | None = None) -> str:
    """The map as the report draws it, and one row per object. The drawing is a picture of its own, so that its styles
    stay out of the page."""
    from edgemap.view.report.markup import el, joined

    poses: list[SE2] = []
    if trajectory is not None and len(trajectory):
        stamps_s = trajectory.stamps_s
        rows = trajectory.at(stamps_s[:: max(1, len(stamps_s) // MAXIMUM_POSES)])
        poses = [SE2(*row) for row in rows.tolist()]
    address = "data:image/svg+xml;base64," + b64encode(map_svg(objects, poses).encode()).decode()
    heads = ("object", "x", "y", "± (95 %)", "seen", "confidence")
    rows_of = [
        el("tr", [el("td", text) for text in (
            item.id, f"{item.position_m[0]:.2f} m", f"{item.position_m[1]:.2f} m",
            f"{ellipse_95(item.covariance_m2)[0]:.2f} m", f"{item.count}×", f"{item.confidence:.2f}")])
        for item in objects
    ]  # fmt: skip
    return joined(
        el("img", src=address, alt=f"map of {len(objects)} objects", style="width:100%;max-width:720px"),
        el("table", el("tr", [el("th", head) for head in heads]), rows_of),
    )


def map_svg(
    objects: Sequence[MapObject],
    poses: Sequence[SE2],
    zones: Sequence[Zone] = (),
    grid: OccupancyGrid | None = None,
) -> str:
    """The report's drawing of the map as an SVG file of its own."""
    from edgemap.view.report.floor_svg import floor_svg

    # Without its rules for narrow screens, where numbers stand for names: there is no legend here.
    style = (Path(__file__).parent / "report" / "report.css").read_text().partition("@media screen and (max-width")[0]
    head, _, rest = floor_svg(objects, poses, zones=zones, grid=grid).partition(">")
    head = head.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
    return f"{head}><style>{style}</style>{rest}"
