"""DDS types of ROS 2's messages, made from the definitions; samples are CDR bytes, encoded elsewhere."""

import re
from functools import cache
from typing import Any

from edgemap.runtime.messages.definitions import FIELDS
from edgemap.runtime.ros2.names import dds_type

PRIMITIVES = {"float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"}


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
