"""ROS 2 messages to CDR bytes and back: the one place that encodes and decodes them."""

import re
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from edgemap.runtime.messages.definitions import Message, definition

DAMAGE = (struct.error, ValueError, LookupError, RuntimeError, OverflowError)  # what a decoder raises at damaged bytes


@cache
def encoder(kind: str) -> Callable[[Message], bytes]:
    """Encodes messages of a kind (`sensor_msgs/msg/CameraInfo`) as little-endian CDR, encapsulation header first.

    Fields that a message leaves out are zero; arrays of int8 are given as bytes. Needs the extra `record`.
    """
    from mcap_ros2._dynamic import serialize_dynamic

    as_bytes = re.sub(r"\bint8\[\]", "uint8[]", definition(kind))  # the same in CDR
    return serialize_dynamic(kind, as_bytes)[kind]


@cache
def decoder(kind: str) -> Callable[[bytes], Any]:
    """Decodes CDR bytes of a kind to an object with the fields as attributes.

    Raises `DAMAGE` at damaged bytes.
    """
    from mcap_ros2._dynamic import generate_dynamic

    return generate_dynamic(kind, definition(kind))[kind]
