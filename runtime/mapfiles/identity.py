"""Ids that other programs ask for: the same object of the same map gets the same UUID, today and tomorrow."""

import uuid

from edgemap.runtime.map_file import FORMAT

DEFAULT_MAP_ID = "map"


def object_uuid(object_id: str, map_id: str = DEFAULT_MAP_ID) -> str:
    """Name-based UUID (RFC 9562, version 5) of an object of a map, as text.

    It depends on both ids only: a map that grows keeps the UUIDs of its objects, on every machine.
    """
    return str(uuid.uuid5(uuid.uuid5(uuid.NAMESPACE_URL, f"{FORMAT}:{map_id}"), object_id))
