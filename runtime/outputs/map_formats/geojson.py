"""A map as GeoJSON: footprints as polygons, the trajectory as a line; in metres of the map frame."""

import json
import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from edgemap.geometry.grid.occupancy_grid import GridRule
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.grid.walls import Wall
from edgemap.geometry.map_object import MapObject, radius_m
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations, Zone
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.step.map_file import (
    DEFAULT_MAP_ID,
    door_record,
    identity_record,
    object_record,
    object_uuid,
    room_record,
    zone_record,
)

FRAME = "local frame map, metres, REP-103 (x forward, y left, counter-clockwise); NOT WGS 84 longitude and latitude"
STEP_M = GridRule().cell_m  # spacing of the trajectory's points


def geojson_text(
    objects: Sequence[MapObject],
    trajectory: Trajectory | None = None,
    map_id: str = DEFAULT_MAP_ID,
    annotations: Annotations = NO_ANNOTATIONS,
    walls: Sequence[Wall] = (),
    rooms: Sequence[Room] = (),
    doors: Sequence[Door] = (),
) -> str:
    """One FeatureCollection. Each object is a Polygon with the fields of map.json as properties; so is each zone, with
    its id and name. Each wall is a LineString, each room a Polygon, each door a LineString.

    RFC 7946 knows WGS 84 only, and other frames by prior arrangement (section 4): the member `frame` states which, and
    `crs: null` (GeoJSON 2008, section 3) that no program should take the numbers for degrees. Exterior rings run
    counter-clockwise (section 3.1.6).
    """
    features = chain(
        (_object(item, map_id) for item in objects),
        (_zone(zone) for zone in annotations.zones),
        (_wall(number, wall) for number, wall in enumerate(walls, start=1)),
        (_feature(one["id"], "Polygon", one.pop("corners_m"), {"room": True} | one) for one in map(room_record, rooms)),
        (
            _feature(one["id"], "LineString", (one.pop("from_m"), one.pop("to_m")), {"door": True} | one)
            for one in map(door_record, doors)
        ),
        (_trajectory(one) for one in (trajectory,) if one is not None),
    )
    document = {
        "type": "FeatureCollection",
        "name": f"edgemap {map_id}: local frame map, metres, REP-103",
        "frame": FRAME,
        "crs": None,
    } | identity_record(annotations.identity)
    head = json.dumps(document, indent=1)[:-2]
    lines = ",\n".join("  " + json.dumps(feature, allow_nan=False) for feature in features)  # one line each
    return f'{head},\n "features": [\n{lines}\n ]\n}}\n'


def _feature(identity: str, kind: str, points_m: Sequence[Sequence[float]], properties: dict) -> dict:
    """A Polygon (its ring is closed here), a LineString, or a Point."""
    ring = [list(point) for point in points_m]
    coordinates = {"Polygon": [ring + ring[:1]], "LineString": ring, "Point": ring[0]}[kind]
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "id": identity, "geometry": geometry, "properties": properties | {"frame": "map"}}


def _object(item: MapObject, map_id: str) -> dict:
    record = object_record(item) | {"uuid": object_uuid(item.id, map_id), "radius_m": round(radius_m(item), 4)}
    return _feature(item.id, "Polygon", record.pop("footprint"), record)


def _zone(zone: Zone) -> dict:
    ring = zone_record(zone)["corners_m"]
    if sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(ring, ring[1:] + ring[:1], strict=True)) < 0.0:
        ring.reverse()
    return _feature(zone.id, "Polygon", ring, {"zone": zone.name})


def _wall(number: int, wall: Wall) -> dict:
    ends = np.round([wall.from_m, wall.to_m], 4).tolist()
    return _feature(f"wall-{number}", "LineString", ends, {"wall": True, "length_m": round(wall.length_m, 3)})


def _trajectory(trajectory: Trajectory) -> dict:
    points = [[round(trajectory.poses[0].x_m, 3), round(trajectory.poses[0].y_m, 3)]]
    for pose in trajectory.poses:
        if math.dist(points[-1], (pose.x_m, pose.y_m)) >= STEP_M:
            points.append([round(pose.x_m, 3), round(pose.y_m, 3)])
    kind = "LineString" if len(points) > 1 else "Point"  # a line needs two points
    return _feature("trajectory", kind, points, {"label": "robot's trajectory"})
