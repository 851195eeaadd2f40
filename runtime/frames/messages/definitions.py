"""The ROS 2 message definitions of definitions.txt, and the one place that encodes and decodes CDR by them."""

import re
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

Message = dict[str, Any]  # a message by field name; fields that are left out are zero

SEPARATOR = "=" * 80

_SECTIONS = Path(__file__).with_name("definitions.txt").read_text().split("\nMSG: ")[1:]
FIELDS = {kind: fields.strip() for kind, _, fields in (section.partition("\n") for section in _SECTIONS)}
DAMAGE = (struct.error, ValueError, LookupError, RuntimeError, OverflowError)  # what a decoder raises at damaged bytes


def definition(kind: str) -> str:
    """A type's own fields, then those of every type it needs, as MCAP's `ros2msg` encoding wants them.

    kind: as in ROS 2, `sensor_msgs/msg/CameraInfo`.
    """
    name = kind.replace("/msg/", "/")
    needed = [name]
    for known in needed:  # grows while it is walked
        for used in re.findall(r"^(\w+/\w+)", FIELDS[known], re.MULTILINE):
            if used not in needed:
                needed.append(used)
    parts = [FIELDS[name] + "\n"]
    parts += [f"{SEPARATOR}\nMSG: {used}\n{FIELDS[used]}\n" for used in needed[1:]]
    return "".join(parts)


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
