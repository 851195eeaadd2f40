"""A map as Python programs get it: a list of objects with what belongs to it; in a notebook a drawing and a table."""

from base64 import b64encode
from collections.abc import Iterable
from html import escape
from pathlib import Path

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.grid.walls import walls_of
from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.rooms import rooms_of
from edgemap.runtime.frames.trajectory import Trajectory, trajectory_of
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, map_svg
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.shapes import MAXIMUM_SHAPES
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import DEFAULT_MAP_ID, load_annotated_map
from edgemap.runtime.step.map_store import saved_map
from edgemap.runtime.step.pose_journal import PoseJournal


class MapObjects(list[MapObject]):
    """A list of objects that a notebook shows as the map from above and a table. annotations: zones, dock, identity
    with the verdict. grid: the floor. scale: of the trajectory, which is that of the drive."""

    def __init__(
        self,
        objects: Iterable[MapObject] = (),
        trajectory: PoseJournal | Trajectory | None = None,
        annotations: Annotations = NO_ANNOTATIONS,
        grid: OccupancyGrid | None = None,
        scale: float = 1.0,
    ) -> None:
        super().__init__(objects)
        self.annotations, self.grid = annotations, grid
        self._driven, self._scale = trajectory, scale

    @property
    def trajectory(self) -> Trajectory | None:
        """Poses of the base, every few of a long drive."""
        driven = self._driven
        if not isinstance(driven, PoseJournal) or not len(driven):
            return None if isinstance(driven, PoseJournal) else driven
        stamps_s, poses = driven.thinned(MAXIMUM_SHAPES)
        return Trajectory(stamps_s, tuple(pose.scaled(self._scale) for pose in poses))

    @property
    def rooms(self) -> tuple[Room, ...]:
        """The rooms by id, with kind, name, outline and the ids of their objects."""
        return rooms_of(self, self.annotations, self.grid)[0]

    @property
    def doors(self) -> tuple[Door, ...]:
        """The doors by id, each with its rooms and the probability that it is open."""
        return rooms_of(self, self.annotations, self.grid)[1]

    def to_geojson(self) -> str:
        """A FeatureCollection, in metres of the map frame: objects, zones, walls, rooms, doors and the trajectory."""
        identity = self.annotations.identity
        walls = () if self.grid is None else walls_of(self.grid)
        map_id = identity.map_id if identity else DEFAULT_MAP_ID
        return geojson_text(self, self.trajectory, map_id, self.annotations, walls, self.rooms, self.doors)

    def __str__(self) -> str:
        """A line for each object."""
        return "\n".join(f"{item.id}: x {item.x_m:.2f} m, y {item.y_m:.2f} m, {item.confidence:.2f}" for item in self)

    def _repr_html_(self) -> str:
        """The drawing is a separate picture, so that its styles stay out of the page."""
        poses = self.trajectory.poses if self.trajectory else ()
        drawn = DrawnMap(self, poses, (), (), self.annotations.zones, self.grid, self.rooms, self.doors)
        address = "data:image/svg+xml;base64," + b64encode(map_svg(drawn).encode()).decode()
        heads = ("object", "x", "y", "± (95 %)", "seen", "confidence")
        rows = [
            (item.id, f"{item.x_m:.2f} m", f"{item.y_m:.2f} m",
             f"{ellipse_95(item.covariance_m2)[0]:.2f} m", f"{item.count}×", f"{item.confidence:.2f}")
            for item in self
        ]  # fmt: skip
        lines = [f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows]
        table = f"<table><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>{''.join(lines)}</table>"
        style = "width:100%;max-width:720px"
        return f'<img src="{address}" alt="map of {len(self)} objects" style="{style}">{table}'


def load_map_objects(path: str | Path) -> MapObjects:
    """A saved map: a map.json, a run folder, or the name of a map. Raises MapError or OdometryError in one line."""
    place = saved_map(path)
    objects, annotations = load_annotated_map(place)
    return MapObjects(objects, trajectory_of(place), annotations, load_grid(place))
