"""Home Assistant's discovery (2023.8 or newer): the robot as one device with its entities."""

import json
import re
from typing import Any, get_args

from edgemap.geometry.map_object import EventKind
from edgemap.runtime.frames.version import VERSION

EVENTS = (*get_args(EventKind), "entered", "left")
LISTED = "{{ (value_json.occupied_by | join(', '))[:255] or 'empty' }}"


def _state(name: str, value: str, **more: Any) -> tuple[str, dict[str, Any]]:
    return "sensor", {"name": name, "state_topic": "~/state", "value_template": f"{{{{ {value} }}}}"} | more


def _yes(name: str, condition: str, **more: Any) -> tuple[str, dict[str, Any]]:
    template = f"{{{{ 'ON' if {condition} else 'OFF' }}}}"
    return "binary_sensor", {"name": name, "state_topic": "~/state", "value_template": template} | more


MEASURED = {"state_class": "measurement"}
METRES = MEASURED | {"device_class": "distance", "unit_of_measurement": "m"}
ENTITIES: dict[str, tuple[str, dict[str, Any]]] = {
    "objects": _state("Objects", "value_json.objects", json_attributes_topic="~/state", **MEASURED),
    "x": _state("X", "value_json.x_m", **METRES),
    "y": _state("Y", "value_json.y_m", **METRES),
    "heading": _state("Heading", "(value_json.yaw_rad * 57.29578) | round(0)", unit_of_measurement="°", **MEASURED),
    "room": _state("Room", "value_json.room or 'unknown'"),
    "fault": _state("Last fault", "value_json.fault[:255]", entity_category="diagnostic"),
    "unreliable": _yes(
        "Map", "value_json.verdict.level == 'unreliable'", device_class="problem",
        json_attributes_topic="~/state", json_attributes_template="{{ value_json.verdict | tojson }}",
    ),
    "camera": _yes("Camera", "value_json.camera == 'running'", device_class="connectivity"),
    "changes": ("event", {"name": "Changes", "state_topic": "~/events", "event_types": EVENTS}),
    "picture": (
        "image",
        {"name": "Map picture", "image_topic": "~/map", "content_type": "image/png", "image_encoding": "b64"},
    ),
    "relocalise": ("button", {"name": "Relocalise in dock", "command_topic": "~/command", "payload_press": "in dock"}),
    "save": ("button", {"name": "Save map", "command_topic": "~/command", "payload_press": "save"}),
}  # fmt: skip


def device_identity(robot: str) -> str:
    """A robot's id in discovery topics."""
    return "edgemap-" + re.sub(r"[^A-Za-z0-9_-]", "_", robot)


def discovery(robot: str, root: str) -> dict[str, str]:
    """Topics and payloads that make a robot a device, one for each entity."""
    return {
        config_topic(robot, kind, name): _config(robot, root, name, entity) for name, (kind, entity) in ENTITIES.items()
    }


def zone_discovery(robot: str, root: str, zone: str, name: str) -> tuple[str, str]:
    """Topic and payload of a zone's entity. zone: its id."""
    topic = f"~/zones/{zone}"
    entity = {"name": name or zone, "state_topic": topic, "json_attributes_topic": topic, "value_template": LISTED}
    return config_topic(robot, "sensor", zone), _config(robot, root, zone, entity)


def config_topic(robot: str, kind: str, name: str) -> str:
    """The topic of an entity's configuration."""
    return f"homeassistant/{kind}/{device_identity(robot)}/{name}/config"


def _config(robot: str, root: str, name: str, entity: dict[str, Any]) -> str:
    identity = device_identity(robot)
    shared = {
        "~": root,
        "device": {"identifiers": [identity], "name": robot, "manufacturer": "edgemap", "sw_version": VERSION},
        "origin": {"name": "edgemap", "sw_version": VERSION},
        "availability_topic": "~/status",
        "unique_id": f"{identity}-{name}",
    }
    return json.dumps(entity | shared)
