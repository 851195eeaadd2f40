"""Objects that come into a zone and leave it."""

from dataclasses import replace

import numpy as np
from support.rooms import mapped

from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.zone_watch import ZoneWatch

HALL = Zone("zone-1", "hall", ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)))
(CHAIR,) = mapped([("chair", 1.0, 1.0)])
OUT = replace(CHAIR, position_m=np.array([3.0, 1.0]))


def told(watch, frames):
    """Kinds and stamps of the events of frames 0.1 s apart: what is on the map, and how many frames long."""
    events, stamp_s = [], 0.0
    for objects, count in frames:
        for _ in range(count):
            events += watch.update(objects, [HALL], stamp_s)
            stamp_s = round(stamp_s + 0.1, 6)
    return [(event.kind, event.item.id) for event in events], events


def test_what_is_there_at_first_is_no_event_and_what_moves_is():
    kinds, events = told(ZoneWatch(), [([CHAIR], 20), ([OUT], 20), ([CHAIR], 20), ([], 20)])
    assert kinds == [("left", "chair-1"), ("entered", "chair-1"), ("left", "chair-1")]
    assert 3.0 <= events[0].stamp_s <= 3.6  # settled for a second
    assert events[0].record() == {
        "event_type": "left", "zone": "zone-1", "zone_name": "hall", "id": "chair-1", "label": "chair", "x_m": 1.0,
        "y_m": 1.0,
    }  # fmt: skip


def test_a_centre_that_wavers_on_the_border_is_no_event():
    kinds, _ = told(ZoneWatch(), [([CHAIR], 20), *[([OUT], 6), ([CHAIR], 6)] * 8])
    assert kinds == []


def test_a_new_object_enters_and_a_new_zone_has_what_is_in_it():
    kinds, _ = told(ZoneWatch(), [([], 20), ([CHAIR], 20)])
    assert kinds == [("entered", "chair-1")]
    watch = ZoneWatch()
    assert watch.update([CHAIR], [], 0.0) == []
    assert watch.update([CHAIR], [HALL], 1.0) == []  # drawn around it
    larger = replace(HALL, corners_m=((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)))
    assert watch.update([OUT], [larger], 2.0) == []
    assert watch.update([OUT], [], 3.0) == []
