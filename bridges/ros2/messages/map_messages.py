"""The map as ROS 2 messages: its objects, for programs (Detection3DArray) and for eyes (MarkerArray), and the floor."""

import math
from enum import IntEnum

import numpy as np

from edgemap.bridges.ros2.messages.build import header, instance_id, orientation
from edgemap.bridges.ros2.messages.definitions import Message
from edgemap.bridges.ros2.messages.topics import IDS, FrameIds
from edgemap.geometry.grid.floor_scan import FloorScan
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.objects.annotations import MapIdentity
from edgemap.runtime.frames.colours import label_rgb
from edgemap.runtime.outputs.map_formats.grid import FloorCells

TALLEST_M, FLAT_M, LETTER_M = 2.5, 0.01, 0.15
BEAM_RAD = math.radians(0.5)  # of the floor's scan


class Shape(IntEnum):
    """Type of a visualization_msgs/Marker."""

    CUBE = 1
    CYLINDER = 3
    TEXT = 9


def detections_3d(
    stamp_ns: int, objects: list[MapObject], ids: FrameIds = IDS, identity: MapIdentity | None = None
) -> Message:
    """`vision_msgs/Detection3DArray` in the map frame: centre of the footprint raised to half the height, with id,
    label, confidence and the position's covariance. identity: of the map."""
    head, entries = header(stamp_ns, ids.map), []
    for item in objects:
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = item.covariance_m2
        pose = _pose(item)
        hypothesis = {"class_id": item.label, "score": float(item.confidence)}
        entries.append(
            {
                "header": head,
                "results": [
                    {"hypothesis": hypothesis, "pose": {"pose": pose, "covariance": covariance.ravel().tolist()}}
                ],
                "bbox": {"center": pose, "size": _box(item)},
                "id": instance_id(item.id, identity),
            }
        )
    return {"header": head, "detections": entries}


def markers(stamp_ns: int, objects: list[MapObject], ids: FrameIds = IDS) -> Message:
    """`visualization_msgs/MarkerArray`: for each object a box, its name, and its 95 % ellipse on the floor.

    Starts with a marker that takes away all older ones (action DELETEALL), so that objects that merged do not stay.
    """
    entries: list[Message] = [{"header": header(stamp_ns, ids.map), "action": 3}]
    for number, item in enumerate(objects):
        red, green, blue = label_rgb(item.label)
        tint = {"r": red, "g": green, "b": blue}
        long_m, short_m, yaw_rad = ellipse_95(item.covariance_m2)
        common = {"header": header(stamp_ns, ids.map), "id": number}
        box = {"pose": _pose(item), "scale": _box(item)}
        entries.append(common | box | {"ns": "objects", "type": Shape.CUBE, "color": tint | {"a": 0.5}})
        name = {"pose": {"position": _place(item, _height_m(item) + LETTER_M)}, "scale": {"z": LETTER_M}}
        white = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}
        entries.append(common | name | {"ns": "names", "type": Shape.TEXT, "text": item.id, "color": white})
        ellipse = {
            "pose": {"position": _place(item, FLAT_M / 2.0), "orientation": orientation(yaw_rad)},
            "scale": {"x": max(2.0 * long_m, FLAT_M), "y": max(2.0 * short_m, FLAT_M), "z": FLAT_M},
        }
        entries.append(common | ellipse | {"ns": "ellipses", "type": Shape.CYLINDER, "color": tint | {"a": 0.8}})
    return {"markers": entries}


def _place(item: MapObject, z_m: float) -> dict[str, float]:
    return {"x": float(item.position_m[0]), "y": float(item.position_m[1]), "z": z_m}


def _height_m(item: MapObject) -> float:
    return min(max(float(item.height_m), FLAT_M), TALLEST_M)


def _pose(item: MapObject) -> dict[str, dict[str, float]]:
    """Of the middle of its box; x is forward where it has a yaw."""
    pose, yaw_rad = {"position": _place(item, _height_m(item) / 2.0)}, item.footprint.yaw_rad
    return pose if yaw_rad is None else pose | {"orientation": orientation(yaw_rad)}


def _box(item: MapObject) -> dict[str, float]:
    """Sides of its box; as deep as wide, as it appears, where its yaw is unknown."""
    shape = item.footprint
    width_m, depth_m = (item.width_m,) * 2 if shape.yaw_rad is None else (shape.width_m, shape.depth_m)
    return {"x": max(float(depth_m), FLAT_M), "y": max(float(width_m), FLAT_M), "z": _height_m(item)}


def grid_message(stamp_ns: int, grid: OccupancyGrid | FloorCells, ids: FrameIds = IDS) -> Message:
    """`nav_msgs/OccupancyGrid` in the map frame: observed floor free, obstacles occupied, the rest unknown."""
    rows, columns = grid.cells.shape
    origin = {"position": {"x": grid.x_m, "y": grid.y_m, "z": 0.0}, "orientation": orientation(0.0)}
    head, size = header(stamp_ns, ids.map), {"width": columns, "height": rows}
    info = {"map_load_time": head["stamp"], "resolution": grid.cell_m, **size, "origin": origin}
    return {"header": head, "info": info, "data": grid.cells.tobytes()}


def scan_message(stamp_ns: int, scan: FloorScan, ids: FrameIds = IDS) -> Message:
    """`sensor_msgs/LaserScan` in the base frame: the nearest contact of each beam of half a degree, NaN where the
    picture has none (REP-117: no measurement, so no cell is cleared). Intensities: the contacts' weights.
    """
    ranges_m = np.hypot(*scan.contacts_base_m.T)
    beams = np.rint(np.arctan2(scan.contacts_base_m[:, 1], scan.contacts_base_m[:, 0]) / BEAM_RAD).astype(np.intp)
    first, last = (int(beams.min()), int(beams.max())) if len(beams) else (0, 0)
    nearest = np.full(last - first + 1, np.nan)
    weights = np.zeros(last - first + 1)
    for at in np.argsort(-ranges_m, kind="stable"):  # the nearest of a beam last
        nearest[beams[at] - first], weights[beams[at] - first] = ranges_m[at], scan.weights[at]
    return {
        "header": header(stamp_ns, ids.base),
        "angle_min": first * BEAM_RAD,
        "angle_max": last * BEAM_RAD,
        "angle_increment": BEAM_RAD,
        "range_min": 0.05,
        "range_max": scan.rule.reach_m + 1.0,  # from the base, the lens may be ahead of it
        "ranges": nearest.tolist(),
        "intensities": weights.tolist(),
    }
