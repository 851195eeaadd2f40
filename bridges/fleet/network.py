"""Communication of a fleet: zenoh names, keys and sessions, messages, and requests for the keeper's merged map."""

import json
import os
import time
import zlib
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from edgemap.bridges.fleet.access import NAME, own_names_only, password_settings
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import Annotations
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import Coordinate, Name, decode_json
from edgemap.runtime.step.map_file import read_map

ROOT, PORT = "edgemap/fleet", 7447
MESSAGE_BYTES, MAP_BYTES = 512 << 10, 16 << 20  # maximum size: compressed, and decompressed
ROBOT_BYTES, MAXIMUM_OBJECTS = 4 << 20, 1000  # of the map of one robot: decompressed size, and objects
ACCEPT_PENDING, ACCEPT_MS = 1000, 2000  # bounds the wait behind connections with an incomplete handshake
PATIENCE_S, ASK_S = 5.0, 1.0
Pose = tuple[Coordinate, Coordinate, Coordinate]


def name_of(text: str, what: str) -> str:
    """Checks the name of a robot or a place, which is part of a key and of a file name. Raises PublishError."""
    if not NAME.fullmatch(text):
        said = "a name has 1 to 64 of A-Z a-z 0-9 _ . - and begins with a letter or digit"
        raise PublishError(f"{what} {text[:70]!r}: {said}")
    return text


def place_key(place: str) -> str:
    """The key of a place, PLACE.

    `PLACE/map`: the merged map. `PLACE/keeper`: the process that maintains it. `PLACE/robots/NAME/map` and
    `PLACE/robots/NAME/pose`: map and pose of one robot.
    """
    return f"{ROOT}/{place}"


def robot_of(key: str) -> str | None:
    """The name of the robot in a key such as `…/robots/NAME` or `…/robots/NAME/map`; None if there is no valid name."""
    name = key.partition("/robots/")[2].partition("/")[0]
    return name if NAME.fullmatch(name) else None


def open_session(
    connect: str = "", listen: str = "", wait_s: float | None = None, passwords: Mapping[str, str] | None = None,
    place: str = "",
) -> Any:  # fmt: skip
    """A zenoh session: a router that listens on an address (`127.0.0.1:7447`), or a peer that connects to one.

    A peer connects in the background and retries until it succeeds. wait_s: connect as a client, which other clients
    and peers reach through a router, and give up after this time. passwords: of the robots of a place; each may send
    under its own name only. If ZENOH_CONFIG names a file, the file sets all of this, and also encryption and access
    control. Otherwise EDGEMAP_FLEET_SECRET, if set, is the password of this side. The challenge and response of zenoh
    do not send the password, and messages are not encrypted. Raises PublishError, or MissingExtraError.
    """
    need("fleet", "--fleet")
    import zenoh

    given = os.environ.get("ZENOH_CONFIG")
    try:
        config = zenoh.Config.from_file(given) if given else zenoh.Config()
        options = {} if given else {
            "mode": "router" if listen else "peer" if wait_s is None else "client",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [f"tcp/{listen}"] if listen else [],
            "connect/endpoints": [f"tcp/{connect}"] if connect else [],
            "connect/timeout_ms": -1 if wait_s is None else round(1e3 * wait_s),
            "connect/exit_on_failure": wait_s is not None,
            "transport/shared_memory/enabled": False,  # its counters end at 351 connections
            "transport/link/rx/max_message_size": MESSAGE_BYTES + 4096,
            "transport/unicast/accept_pending": ACCEPT_PENDING,
            "transport/unicast/accept_timeout": ACCEPT_MS,
        }  # fmt: skip
        with password_settings(passwords or {}) as own:
            if not given:
                options |= own | ({"access_control": own_names_only(passwords, place_key(place))} if passwords else {})
            for key, value in options.items():
                config.insert_json5(key, json.dumps(value))
            return zenoh.open(config)
    except zenoh.ZError as error:
        line = str(error).split(" at ")[0]
        where = f"listening on {listen}" if listen else f"connecting to {connect}"
        raise PublishError(f"fleet, {where}: {line}") from None


def rounded(pose: SE2) -> list[float]:
    """x, y and yaw for messages, rounded to 1 mm and 0.1 mrad."""
    return [round(pose.x_m, 3), round(pose.y_m, 3), round(pose.yaw_rad, 4)]


def packed(document: dict[str, Any]) -> bytes:
    """Encodes a document as a message: compact JSON, compressed with zlib."""
    return zlib.compress(json.dumps(document, separators=(",", ":")).encode(), 6)


def unpacked(message: bytes, source: str, limit: int = MAP_BYTES) -> bytes:
    """Decompresses the JSON text of a message. Raises MapError if it is too large or damaged."""
    if len(message) > MESSAGE_BYTES:
        raise MapError(f"{source}: a message of {len(message):,} bytes, at most {MESSAGE_BYTES:,} are read")
    inflate = zlib.decompressobj()
    try:
        text = inflate.decompress(message, limit)
    except zlib.error as error:
        raise MapError(f"{source}: a damaged message ({error})") from None
    if not inflate.eof:
        raise MapError(f"{source}: a message that is cut off, or of more than {limit:,} bytes once inflated")
    return text


def unpacked_map(message: bytes, source: str) -> tuple[list[MapObject], Annotations]:
    """Decodes a robot's map and checks every value; a map that is too large is rejected first. Raises MapError."""
    return read_map(unpacked(message, source, ROBOT_BYTES), source, MAXIMUM_OBJECTS)


class _Robot(msgspec.Struct):
    here: bool
    objects: int
    pairs: int = 0
    shared: int = 0
    map_age_s: float | None = None
    pose_place_map: Pose | None = None
    pose_place_base: Pose | None = None
    apart: Annotated[str, Meta(max_length=1000)] | None = None
    refused: Annotated[str, Meta(max_length=1000)] | None = None

    def __post_init__(self) -> None:
        if not self.apart and self.pose_place_map is None:
            raise ValueError("a robot has a pose in the place, or is apart")


class _Fleet(msgspec.Struct):
    place: Name
    robots: dict[Name, _Robot]


class _Document(msgspec.Struct):
    objects: list[Any]
    fleet: _Fleet


def place_document(place: str, address: str) -> tuple[dict[str, Any], bytes]:
    """Requests the current `map.json` of a place. Returns the checked document and its text.

    Raises PublishError if no keeper answers within five seconds, MapError for an invalid answer, or
    MissingExtraError.
    """
    session = open_session(connect=address, wait_s=PATIENCE_S)
    try:
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            for reply in session.get(f"{place_key(name_of(place, 'place'))}/map", timeout=ASK_S):
                if reply.ok is not None:
                    source = f"map of {place}"
                    text = unpacked(reply.ok.payload.to_bytes(), source)
                    read_map(text, source)
                    decode_json(text, _Document, source, MapError)
                    return json.loads(text), text
            time.sleep(0.1)
    finally:
        session.close()
    raise PublishError(f"nobody keeps the map of {place} at {address} (no answer within {PATIENCE_S:.0f} s)")
