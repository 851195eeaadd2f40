"""How ROS 2 names topics and types on DDS, and its messages' DDS types; samples are CDR bytes, encoded elsewhere.

Source: https://design.ros2.org/articles/topic_and_service_names.html; rosidl's DDS types end in an underscore.
"""

import re
from functools import cache
from typing import Any

from edgemap.bridges.ros2.messages.definitions import FIELDS
from edgemap.runtime.frames.errors import BridgeError

TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


@cache
def sample_type(kind: str) -> Any:
    """The type of a kind (`nav_msgs/msg/Odometry`) for `cyclonedds.topic.Topic`: a class whose instances hold `cdr`.

    Final and in the first version of CDR, as rosidl's types are; other Cyclone programs compare it field by field.
    """
    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.annotations import final

    name = dds_type(kind)
    fields: dict[str, Any] = {}
    for line in FIELDS[kind.replace("/msg/", "/")].splitlines():
        text, field = line.split()[:2]
        fields[f"{field}_"] = _field(text)
    made: Any = final(make_idl_struct(name.rpartition("::")[2], name, fields, dataclassify=False))
    made.__init__, made.serialize, made.deserialize = _hold, _bytes, classmethod(_made_of)
    return made


def _field(text: str) -> Any:
    from cyclonedds.idl import types

    base, size = re.fullmatch(r"([\w/]+?)(\[\d*\])?", text).groups()  # type: ignore[union-attr]
    if "/" in base:
        inner: Any = sample_type(base.replace("/", "/msg/"))
    else:
        inner = {"string": str, "bool": bool}.get(base) or getattr(types, base)
    if size is None:
        return inner
    return types.sequence[inner] if size == "[]" else types.array[inner, int(size[1:-1])]


def _hold(self: Any, cdr: bytes) -> None:
    self.cdr = cdr


def _bytes(self: Any, *_: Any, **__: Any) -> bytes:
    return self.cdr


def _made_of(kind: Any, data: bytes, *_: Any, **__: Any) -> Any:
    sample = object.__new__(kind)
    sample.cdr = data
    return sample


def dds_topic(topic: str) -> str:
    """`/tf` as `rt/tf`. Raises BridgeError unless the name is absolute."""
    if not TOPIC.fullmatch(topic) or "__" in topic:
        raise BridgeError(f"{topic!r} is no ROS 2 topic: slashes, letters, digits and single underscores")
    return "rt" + topic


def dds_type(kind: str) -> str:
    """`sensor_msgs/msg/Image` as `sensor_msgs::msg::dds_::Image_`."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_kind(type_name: str) -> str:
    """`sensor_msgs::msg::dds_::Image_` as `sensor_msgs/msg/Image`; other names as they are."""
    match = re.fullmatch(r"(\w+)::msg::dds_::(\w+)_", type_name)
    return f"{match[1]}/msg/{match[2]}" if match else type_name


def in_namespace(namespace: str, topic: str) -> str:
    """A topic below a namespace (`robot1` or `/robot1`; empty for none)."""
    return f"/{namespace.strip('/')}{topic}" if namespace.strip("/") else topic
