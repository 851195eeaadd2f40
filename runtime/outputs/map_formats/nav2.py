"""A map for Nav2: an occupancy picture with its YAML for the map_server, shapes for the Vector Object server, and
zones as masks for the costmap filters: where a robot must not go, and how fast it may be."""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject, outline_m, radius_m
from edgemap.geometry.objects.annotations import Zone
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.outputs.map_formats.grid import FREE, MAXIMUM_CELLS, OCCUPIED, FloorCells
from edgemap.runtime.outputs.map_formats.shapes import MAXIMUM_SHAPES
from edgemap.runtime.step.map_file import DEFAULT_MAP_ID, object_uuid

MARGIN_M = 1.0  # of empty mask around the zones
FRAME_ID = "map"


def write_nav2(path: Path, grid: FloorCells) -> tuple[Path, Path]:
    """Write `path` (YAML) and the picture of the same name; both paths. Raises MapError.

    The picture's first row is its top: the greatest y. Its lower left corner lies at `origin` (x, y, yaw) of the map
    frame, columns run along x. Source: https://docs.nav2.org/configuration/packages/configuring-map-server.html and
    nav2_map_server's map_io.cpp (cell (x, height - y - 1) is pixel (x, y)).
    """
    # As map_saver writes them: darkness is occupancy, (255 - value) / 255; unknown lies between both thresholds.
    pixels = np.select([grid.cells == FREE, grid.cells == OCCUPIED], [254, 0], 205).astype(np.uint8)
    note = f"# edgemap: {grid.cell_m:g} m per pixel\n"
    return path, write_picture(path, pixels, "trinary", grid.cell_m, (grid.x_m, grid.y_m), note)


def write_picture(
    path: Path, pixels: NDArray[np.uint8], mode: str, resolution_m: float, corner_m: Sequence[float], note: str = ""
) -> Path:
    """Writes a picture for the map_server, PGM, and `path`, the YAML that describes it; the picture's path. pixels:
    (rows, columns), row 0 with the smallest y. corner_m: of the first pixel. note: comment lines of the PGM."""
    picture = path.with_suffix(".pgm")
    rows, columns = pixels.shape
    write_atomically(picture, f"P5\n{note}{columns} {rows}\n255\n".encode() + pixels[::-1].tobytes())
    described = {
        "image": picture.name, "mode": mode, "resolution": round(resolution_m, 6),
        "origin": [round(float(corner_m[0]), 6), round(float(corner_m[1]), 6), 0.0], "negate": 0,
        "occupied_thresh": 0.65, "free_thresh": 0.196,
    }  # fmt: skip
    options = {"sort_keys": False, "default_flow_style": None, "allow_unicode": True, "width": math.inf}
    write_atomically(path, yaml.safe_dump(described, **options))
    return picture


def vector_text(
    objects: Sequence[MapObject],
    map_id: str = DEFAULT_MAP_ID,
    resolution_m: float = 0.05,
    zones: Sequence[Zone] = (),
    keep_out: Sequence[str] = (),
) -> str:
    """A ROS 2 parameter file: `shapes` names them, and under each name are type, uuid, frame_id, value, and a circle's
    center, radius and fill or a polygon's points. Objects are rectangles, and circles where their yaw is unknown. Zones
    are polygons, before the objects, which lie over them: those named in keep_out are filled and occupied, the others
    outlines of unknown cells.

    Source: https://docs.nav2.org/configuration/packages/map_server/configuring-vector-object-server.html and
    nav2_map_server's vector_object_shapes.cpp: centre and radius must be floating-point numbers, an integer is refused.
    Names are lower case with underscores, as that page has them from ROS 2 Lyrical on; older versions take them too.
    """
    if len(objects) > MAXIMUM_SHAPES:
        raise MapError(f"{len(objects)} objects: at most {MAXIMUM_SHAPES} are shapes of a parameter file")
    shapes: dict[str, dict[str, Any]] = {}

    def add(identity: str, kind: str, value: int, **form: Any) -> None:
        known = {"type": kind, "uuid": object_uuid(identity, map_id), "frame_id": FRAME_ID, "value": value}
        shapes[_unused(identity, shapes)] = known | form

    for zone in zones:
        closed = zone.name in keep_out or zone.id in keep_out
        add(zone.id, "polygon", 100 if closed else -1, closed=closed, points=_numbers(zone.corners_m))
    for item in objects:
        if item.footprint.yaw_rad is None:
            add(item.id, "circle", 100, fill=True, center=_numbers(item.position_m), radius=round(radius_m(item), 4))
        else:
            add(item.id, "polygon", 100, closed=True, points=_numbers(outline_m(item)))
    parameters: dict[str, Any] = {
        "map_topic": "vo_map", "global_frame_id": FRAME_ID, "resolution": float(resolution_m), "default_value": -1,
        "overlay_type": 0, "update_frequency": 1.0, "transform_tolerance": 0.1,
    }  # fmt: skip
    if shapes:  # an empty list has no type in a parameter file
        parameters["shapes"] = list(shapes)
    document = {"vector_object_server": {"ros__parameters": parameters | shapes}}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)


def _numbers(points_m: ArrayLike) -> list[float]:
    """Coordinates one after the other."""
    return np.asarray(points_m, dtype=np.float64).round(4).ravel().tolist()


def _unused(identity: str, taken: Mapping[str, Any]) -> str:
    """A shape's name: `potted plant-1` and `potted-plant-1` are two shapes."""
    name = re.sub(r"[^a-z0-9]+", "_", identity.lower()).strip("_")
    name = name if name[:1].isalpha() else f"object_{name}"
    names = chain([name], (f"{name}_{number}" for number in count(2)))
    return next(unused for unused in names if unused not in taken)


def write_masks(
    path: Path,
    zones: Sequence[Zone],
    keep_out: Sequence[str],
    speeds: Mapping[str, int],
    resolution_m: float = 0.05,
) -> list[Path]:
    """Masks of zones by name, next to `path`: NAME.keepout.yaml and .pgm, NAME.speed.yaml and .pgm; the YAML files.

    speeds: in each zone, percent of the robot's highest, 1 to 100; the lowest counts where zones overlap. Pixels
    are the mask's values as they are (mode raw): 100 for keep-out with a filter of type 0, the percentage with a filter
    of type 1, base 0.0 and multiplier 1.0, whose 0 is no limit. Raises MapError for a zone that is not there. Source:
    https://docs.nav2.org/configuration/packages/map_server/configuring-costmap-filter-info-server.html and
    https://docs.nav2.org/configuration/packages/costmap-plugins/speed_filter.html
    """
    for name in (*keep_out, *speeds):
        if not any(zone.name == name or zone.id == name for zone in zones):
            known = ", ".join(zone.name for zone in zones) or "none"
            raise MapError(f"no zone {name!r} on the map; it has {known}")
    written = []
    if keep_out:
        values = [(zone, OCCUPIED) for zone in zones if zone.name in keep_out or zone.id in keep_out]
        written.append(_write(path, "keepout", values, resolution_m))
    if speeds:
        limits = [(zone, speeds.get(zone.name, speeds.get(zone.id, 0))) for zone in zones]
        slowest_last = sorted((pair for pair in limits if pair[1]), key=lambda pair: -pair[1])
        written.append(_write(path, "speed", slowest_last, resolution_m))
    return written


def _write(path: Path, kind: str, values: Sequence[tuple[Zone, int]], resolution_m: float) -> Path:
    corners = np.array([corner for zone, _ in values for corner in zone.corners_m])
    low = np.floor((corners.min(axis=0) - MARGIN_M) / resolution_m) * resolution_m
    columns, rows = np.ceil((corners.max(axis=0) + MARGIN_M - low) / resolution_m).astype(int).tolist()
    if rows * columns > MAXIMUM_CELLS:
        raise MapError(f"{columns} x {rows} cells of {resolution_m:g} m: more than {MAXIMUM_CELLS}")
    mask: NDArray[np.uint8] = np.zeros((rows, columns), np.uint8)
    for zone, value in values:
        # fillPoly counts from the middle of a pixel.
        places = np.rint((np.array(zone.corners_m) - low) / resolution_m - 0.5).astype(np.int32)
        cv2.fillPoly(mask, [places], value)
    described = path.with_suffix(f".{kind}.yaml")
    write_picture(described, mask, "raw", resolution_m, low)
    return described
