"""How ROS 2 names topics and types on DDS, and its messages' DDS types; samples are CDR bytes, encoded elsewhere.

Source: https://design.ros2.org/articles/topic_and_service_names.html; rosidl's DDS types end in an underscore.
"""

import re
from functools import cache
from typing import Any

from edgemap.bridges.ros2.messages.definitions import FIELDS
from edgemap.runtime.frames.errors import BridgeError

PRIMITIVES = {"byte", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"}
TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
HASHES = {
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    "nav_msgs/msg/OccupancyGrid": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "std_msgs/msg/Float64": "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "vision_msgs/msg/Detection2DArray": "214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968",
    "vision_msgs/msg/Detection3DArray": "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    "vision_msgs/msg/LabelInfo": "3d37df4015cdf660cc851c51897f2acd957e1ca6205ba0a99aebffb9406b0783",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
}


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
    if base in PRIMITIVES:
        inner: Any = getattr(types, base)
    elif base in ("string", "bool"):
        inner = {"string": str, "bool": bool}[base]
    else:
        inner = sample_type(base.replace("/", "/msg/"))
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
