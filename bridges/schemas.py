"""JSON Schemas of what other programs read, from the types that write and read it.

`python -m edgemap.bridges.schemas DIR` writes them; docs/schema/ holds them.
"""

import json
import sys
from pathlib import Path
from typing import Any, Literal

import msgspec

from edgemap.runtime.frames.reading import Name
from edgemap.runtime.step.map_records import EventRecord, MapRecord, VerdictRecord


class ChangeRecord(EventRecord, kw_only=True):
    """An entry of an object's history, as /api/changes, MQTT and `map show --history --json` give it."""

    id: Name
    label: Name
    name: str = ""


class ZoneEventRecord(msgspec.Struct, kw_only=True):
    """An object came into a zone or left it, as /api/events and MQTT give it."""

    event_type: Literal["entered", "left"]
    zone: Name
    zone_name: str
    id: Name
    label: Name
    x_m: float
    y_m: float
    stamp_s: float = 0.0


KINDS: dict[str, Any] = {
    "map": MapRecord,
    "verdict": VerdictRecord,
    "change": ChangeRecord,
    "zone-event": ZoneEventRecord,
}


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema (2020-12) of a kind of document. Patterns are ECMAScript's."""
    text = json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema"} | msgspec.json.schema(KINDS[name]))
    return json.loads(text.replace(r"\\A", "^").replace(r"\\Z", "$"))


def schema_text(name: str) -> str:
    """The schema as the text of its file."""
    return json.dumps(schema(name), indent=1) + "\n"


if __name__ == "__main__":
    for kind in KINDS:
        (Path(sys.argv[1]) / f"{kind}.json").write_text(schema_text(kind))
