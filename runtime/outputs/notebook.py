"""Display of a map in a notebook: a drawing over a table."""

from base64 import b64encode
from collections.abc import Iterable
from html import escape

from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.se2 import SE2
from edgemap.runtime.outputs.map_formats.drawing import MAXIMUM_POSES, DrawnMap, map_svg
from edgemap.runtime.step.pose_journal import PoseJournal


class MapObjects(list[MapObject]):
    """A list of objects that a notebook shows as the map from above and a table. trajectory: drawn with them."""

    def __init__(self, objects: Iterable[MapObject] = (), trajectory: PoseJournal | None = None) -> None:
        super().__init__(objects)
        self.trajectory = trajectory

    def _repr_html_(self) -> str:
        """The drawing is a picture of its own, so that its styles stay out of the page."""
        poses: list[SE2] = []
        if self.trajectory is not None and len(self.trajectory):
            stamps_s = self.trajectory.stamps_s
            rows = self.trajectory.at(stamps_s[:: max(1, len(stamps_s) // MAXIMUM_POSES)])
            poses = [SE2(*row) for row in rows.tolist()]
        address = "data:image/svg+xml;base64," + b64encode(map_svg(DrawnMap(self, poses)).encode()).decode()
        heads = ("object", "x", "y", "± (95 %)", "seen", "confidence")
        rows = [
            (item.id, f"{item.position_m[0]:.2f} m", f"{item.position_m[1]:.2f} m",
             f"{ellipse_95(item.covariance_m2)[0]:.2f} m", f"{item.count}×", f"{item.confidence:.2f}")
            for item in self
        ]  # fmt: skip
        lines = [f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows]
        table = f"<table><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>{''.join(lines)}</table>"
        style = "width:100%;max-width:720px"
        return f'<img src="{address}" alt="map of {len(self)} objects" style="{style}">{table}'
