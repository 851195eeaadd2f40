"""The published JSON Schemas: made of the types, and met by what a run writes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from support.steps import Steps

from edgemap.bridges.schemas import KINDS, schema, schema_text
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, MapIdentity
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.objects.zone_watch import ZoneWatch
from edgemap.runtime.outputs.verdict.verdict import verdict_of
from edgemap.runtime.step.map_file import change_record, map_document, saved_text

jsonschema = pytest.importorskip("jsonschema")
FOLDER = Path(__file__).parents[2] / "docs" / "schema"


@pytest.fixture(scope="module")
def documents():
    """Documents of each kind, as a run makes them."""
    steps, watch = Steps(), ZoneWatch()
    for _ in range(20):
        steps.next()
    steps.mapper.edit(Edit("name", "chair-1", name="mine"))
    steps.mapper.edit(Edit("dock", pose=(0.0, 1.0, 0.5)))
    steps.mapper.edit(Edit("zone", name="hall", corners_m=((2.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0))))
    objects, annotations = steps.mapper.objects(), steps.mapper.annotations().judged("care", ["dim light"])
    annotations = replace(annotations, vanished=(replace(objects[1], id="couch-9"),))
    watch.update([], annotations.zones, 0.0)
    events = [event for stamp_s in (1.0, 3.0) for event in watch.update(objects, annotations.zones, stamp_s)]
    return {
        "map": [map_document(objects, annotations), json.loads(saved_text(map_document(objects, annotations)))],
        "verdict": [verdict_of({}, objects).document()],
        "change": [change_record(item, event) for item in objects for event in item.history],
        "zone-event": [event.record() | {"stamp_s": event.stamp_s} for event in events],
    }


@pytest.mark.parametrize("kind", KINDS)
def test_documents_meet_their_published_schema(documents, kind):
    assert (FOLDER / f"{kind}.json").read_text() == schema_text(kind), "python -m edgemap.bridges.schemas docs/schema"
    assert documents[kind]
    for document in documents[kind]:
        jsonschema.validate(json.loads(json.dumps(document)), schema(kind))


def test_what_no_map_may_hold_fails():
    document = map_document([], replace(NO_ANNOTATIONS, identity=MapIdentity("home", 0)))
    with pytest.raises(jsonschema.ValidationError, match="0 is less than the minimum of 1"):
        jsonschema.validate(document, schema("map"))
