"""How ROS 2 names topics and types on DDS.

Source: https://design.ros2.org/articles/topic_and_service_names.html; rosidl's DDS types end in an underscore.
"""

import re

from edgemap.runtime.errors import Ros2Error

TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


def dds_topic(topic: str) -> str:
    """`/tf` as `rt/tf`. Raises Ros2Error for what is no absolute topic name."""
    if not TOPIC.fullmatch(topic) or "__" in topic:
        raise Ros2Error(f"{topic!r} is no ROS 2 topic: slashes, letters, digits and single underscores")
    return "rt" + topic


def dds_type(kind: str) -> str:
    """`sensor_msgs/msg/Image` as `sensor_msgs::msg::dds_::Image_`."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_kind(type_name: str) -> str:
    """`sensor_msgs::msg::dds_::Image_` as `sensor_msgs/msg/Image`; other names as they are."""
    found = re.fullmatch(r"(\w+)::msg::dds_::(\w+)_", type_name)
    return f"{found[1]}/msg/{found[2]}" if found else type_name


def in_namespace(namespace: str, topic: str) -> str:
    """A topic below a namespace (`robot1` or `/robot1`; empty for none)."""
    return f"/{namespace.strip('/')}{topic}" if namespace.strip("/") else topic
