"""The sightings of a run folder: `sightings.jsonl`, and the merged ids of `run.json`."""

from io import BytesIO
from pathlib import Path

import msgspec

from edgemap.geometry.errors import MapError
from edgemap.runtime.frames.reading import Coordinate, Name, decode_json, read_bytes


class SeenRecord(msgspec.Struct):
    """One sighting. object: id of its object, empty without one. map_m: x, y."""

    label: Name
    map_m: tuple[Coordinate, Coordinate]
    object: str = ""


class _Run(msgspec.Struct):
    merged: dict[str, str] = msgspec.field(default_factory=dict)


def read_sightings(folder: Path) -> list[SeenRecord]:
    """The observations of a run; an object that was merged into another has the other's id.

    Raises MapError with the line number for a damaged line; an incomplete last line (a power cut) is ignored.
    """
    path = folder / "sightings.jsonl"
    try:
        merged = decode_json(read_bytes(folder / "run.json", MapError), _Run, "run.json", MapError).merged
    except MapError:
        merged = {}
    records = []
    for number, line in enumerate(BytesIO(read_bytes(path, MapError)), start=1):
        if not line.endswith(b"\n"):
            break
        record = decode_json(line, SeenRecord, f"{path}:{number}: damaged line", MapError)
        record.object = merged.get(record.object, record.object)
        records.append(record)
    return records
