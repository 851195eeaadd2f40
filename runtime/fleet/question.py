"""The merged map of a place, asked of who keeps it."""

import json
import time
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from edgemap.geometry.errors import MapError
from edgemap.runtime.errors import PublishError
from edgemap.runtime.fleet.network import name_of, open_session, place_key, unpacked
from edgemap.runtime.map_file import read_map
from edgemap.runtime.reading import Coordinate, Name, decode_json

PATIENCE_S, ASK_S = 5.0, 1.0
Pose = tuple[Coordinate, Coordinate, Coordinate]


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


class _Fleet(msgspec.Struct):
    place: Name
    robots: dict[Name, _Robot]


class _Document(msgspec.Struct):
    objects: list[Any]
    fleet: _Fleet


def place_document(place: str, address: str) -> tuple[dict[str, Any], bytes]:
    """`map.json` of a place as it is now, checked, and its text.

    Raises PublishError where nobody is there or answers within five seconds, MapError for an answer that is no map, or
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
