"""What is true of each picture and of the whole drive: boxes with their visible share, objects with footprints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from edgemap.geometry.se2 import SE2
from edgemap.runtime.drives.drive import SEEN_SHARE, SEEN_SIDE_PX
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.view import View

_SMALLEST_PX = 40


def picture_boxes(renderer: Renderer, view: View, apartment: Apartment) -> list[dict[str, Any]]:
    """Labelled objects in view: `id`, `label`, `box` around the visible pixels, `visible` share 0..1.

    A box is (x0, y0, x1, y1) with pixel k covering k to k + 1, cut by the picture's border. The share is of
    the object's whole silhouette, so both what hides it and the border lower it.
    """
    ids, _ = renderer.ids_and_depth(view)
    extents, counts = find_objects(ids), np.bincount(ids.ravel())
    records = []
    for item in apartment.furniture:
        if not item.label or item.id >= len(counts) or counts[item.id] < _SMALLEST_PX:
            continue
        pixels = int(counts[item.id])
        rows, columns = extents[item.id - 1]
        box = [columns.start, rows.start, columns.stop, rows.stop]
        whole = max(renderer.silhouette_px(view, item.id), float(pixels))
        records.append({"id": item.id, "label": item.label, "box": box, "visible": round(pixels / whole, 3)})
    return records


def is_seen(record: dict[str, Any]) -> bool:
    """Whether a box record counts as a sighting: large and visible enough."""
    x0, y0, x1, y1 = record["box"]
    return max(x1 - x0, y1 - y0) >= SEEN_SIDE_PX and record["visible"] >= SEEN_SHARE


def object_records(
    apartment: Apartment, pose_home_map: SE2, boxes: Sequence[Sequence[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """One record per labelled object, in the map frame: position of the footprint's centre, footprint, size in metres,
    and in how many pictures it counts as seen."""
    pose_map_home = pose_home_map.inverse()
    seen = [record["id"] for frame in boxes for record in frame if is_seen(record)]
    records = []
    for item in apartment.furniture:
        if not item.label:
            continue
        centre = pose_map_home.apply([item.pose_home_object.x_m, item.pose_home_object.y_m])
        footprint = pose_map_home.apply(item.footprint_home_m())
        records.append(
            {
                "id": item.id,
                "label": item.label,
                "x_m": _rounded(centre[0]),
                "y_m": _rounded(centre[1]),
                "on_floor": item.on_floor,
                "footprint_m": [[_rounded(x), _rounded(y)] for x, y in footprint],
                "width_m": _rounded(item.model.width_m),
                "depth_m": _rounded(item.model.depth_m),
                "height_m": _rounded(item.model.height_m),
                "visible_frames": seen.count(item.id),
            }
        )
    return records


def _rounded(value: NDArray[np.float64] | float) -> float:
    return round(float(value), 4)
