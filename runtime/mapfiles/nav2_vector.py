"""A map as vector objects for Nav2's Vector Object server: one circle with a UUID per object."""

import re
from collections.abc import Sequence
from typing import Any

import yaml

from edgemap.geometry.objects.footprints import radius_m
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.mapfiles.identity import DEFAULT_MAP_ID, object_uuid

FRAME_ID = "map"


def vector_text(objects: Sequence[MapObject], map_id: str = DEFAULT_MAP_ID, resolution_m: float = 0.05) -> str:
    """A ROS 2 parameter file: `shapes` names them, and under each name are type, uuid, frame_id, value, and a circle's
    center, radius and fill. Circles, because the way an object faces is not known.

    Source: https://docs.nav2.org/configuration/packages/map_server/configuring-vector-object-server.html and
    nav2_map_server's vector_object_shapes.cpp: centre and radius must be floating-point numbers, an integer is refused.
    Names are lower case with underscores, as that page has them from ROS 2 Lyrical on; older versions take them too.
    """
    shapes: dict[str, dict[str, Any]] = {}
    for item in objects:
        shapes[_unused(_name(item.id), shapes)] = {
            "type": "circle",
            "uuid": object_uuid(item.id, map_id),
            "frame_id": FRAME_ID,
            "fill": True,
            "value": 100,
            "center": [round(float(value), 4) for value in item.position_m],
            "radius": round(radius_m(item), 4),
        }
    parameters: dict[str, Any] = {
        "map_topic": "vo_map", "global_frame_id": FRAME_ID, "resolution": float(resolution_m), "default_value": -1,
        "overlay_type": 0, "update_frequency": 1.0, "transform_tolerance": 0.1,
    }  # fmt: skip
    if shapes:  # an empty list has no type in a parameter file
        parameters["shapes"] = list(shapes)
    document = {"vector_object_server": {"ros__parameters": parameters | shapes}}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)


def _name(identity: str) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", identity.lower()).strip("_")
    return name if name[:1].isalpha() else f"object_{name}"


def _unused(name: str, taken: dict[str, Any]) -> str:
    """`potted plant-1` and `potted-plant-1` are two shapes."""
    count = 2
    unused = name
    while unused in taken:
        unused, count = f"{name}_{count}", count + 1
    return unused
