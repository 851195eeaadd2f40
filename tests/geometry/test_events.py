"""A person's edits as one list of events: what each states, and what taking one back leaves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.rooms import mapped

from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.events import UNDOABLE, Edit, EditError, MapEvents
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.map_file import map_document

MEASURED = mapped([("chair", 1.0, 2.0), ("chair", 3.0, 2.0), ("couch", 5.0, 0.0), ("tv", 0.0, 5.0)])
IDS = [item.id for item in MEASURED]
METRES = st.floats(0.1, 5.0)
PLACES = st.tuples(st.integers(1, 50).map(lambda k: 10.0 * k), st.just(50.0))  # no two objects overlap there
CORRECTIONS = st.builds(
    Edit, st.just("correct"), st.just("chair-1"), label=st.sampled_from(["", "bench", "couch"]),
    place_m=st.none() | PLACES, size_m=st.none() | st.tuples(METRES, METRES, METRES),
    yaw_rad=st.none() | st.floats(-3.0, 3.0),
).filter(lambda edit: edit.label or (edit.place_m, edit.size_m, edit.yaw_rad) != (None, None, None))  # fmt: skip
SQUARE = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))
EDITS = st.one_of(
    CORRECTIONS,
    st.builds(Edit, st.sampled_from(["delete", "confirm"]), st.sampled_from(IDS)),
    st.builds(Edit, st.just("name"), st.sampled_from(IDS), name=st.sampled_from(["", "mine", "yours"])),
    st.builds(Edit, st.just("merge"), st.sampled_from(IDS), into=st.sampled_from(IDS)),
    st.builds(Edit, st.just("add"), label=st.sampled_from(["chair", "tv"]), place_m=PLACES),
    st.builds(Edit, st.just("zone"), name=st.sampled_from(["hall", "bath"]), corners_m=st.just(SQUARE)),
    st.builds(Edit, st.just("room"), st.just("room-1"), name=st.just("den"), corners_m=st.just(SQUARE)),
    st.builds(Edit, st.just("dock"), pose=st.tuples(METRES, METRES, METRES)),
)


def measured():
    config = Config()
    return FloorMap(config.association, config.loop_closure).continued(MEASURED)


def anchors(points):
    return np.arange(len(points), dtype=float)


def taken(events, base, edits):
    """Takes the edits that the map allows; those, each with the id that it has."""
    done = []
    for edit in edits:
        try:
            done.append(replace(edit, id=events.take(edit, base, anchors)))
        except EditError:
            continue
    return done


def document(events, base):
    return map_document(events.shown(base), events.annotations(base))


@given(st.lists(EDITS, max_size=12, unique_by=lambda edit: edit.place_m or edit))
@settings(max_examples=60)
def test_a_map_with_edits_is_saved_and_gone_on_with(edits):
    base, events = measured(), MapEvents()
    taken(events, base, edits)
    objects, annotations = events.shown(base), events.annotations(base)
    ids = [item.id for item in (*objects, *annotations.deleted)]
    assert len(ids) == len(set(ids))
    config = Config()
    later = FloorMap(config.association, config.loop_closure).continued(annotations.measured(objects))
    again = MapEvents.of(objects, annotations)
    assert map_document(again.shown(later), again.annotations(later)) == map_document(objects, annotations)


@given(st.lists(EDITS, max_size=8), EDITS)
@settings(max_examples=60)
def test_undo_takes_back_the_last_edit_as_if_it_had_never_been(edits, edit):
    base, events = measured(), MapEvents()
    done = taken(events, base, edits)
    before = document(events, base)
    for last in taken(events, base, [edit]):
        replaced = any((one.do, one.id) == (last.do, last.id) for one in done)
        if last.do in UNDOABLE and not replaced:
            events.take(Edit("undo", last.id), base, anchors)
            assert document(events, base) == before


@given(CORRECTIONS, CORRECTIONS)
def test_a_newer_correction_changes_what_it_states_and_undo_takes_both_back(older, newer):
    base, events = measured(), MapEvents()
    before = document(events, base)
    taken(events, base, [older, newer])
    item = next(item for item in events.shown(base) if item.id == "chair-1")
    chair = MEASURED[0]
    assert item.label == (newer.label or older.label or "chair")
    assert item.position_m.tolist() == list(newer.place_m or older.place_m or (1.0, 2.0))
    sizes = newer.size_m or older.size_m or (chair.width_m, chair.depth_m, chair.height_m)
    assert (item.width_m, item.depth_m, item.height_m) == sizes
    assert item.yaw_rad == (older.yaw_rad if newer.yaw_rad is None else newer.yaw_rad)
    events.take(Edit("undo", "chair-1"), base, anchors)
    assert document(events, base) == before
    assert events.annotations(base) is NO_ANNOTATIONS


def test_a_deleted_object_comes_back_as_it_was_named_and_corrected_also_in_a_later_run():
    base, events = measured(), MapEvents()
    taken(events, base, [Edit("name", "tv-1", name="the tv"), Edit("correct", "tv-1", size_m=(1.0, 0.1, 0.6))])
    before = document(events, base)
    events.take(Edit("delete", "tv-1"), base, anchors)
    later = MapEvents.of(events.shown(base), events.annotations(base))
    assert "tv-1" not in [item.id for item in later.shown(base)]
    later.take(Edit("undo", "tv-1"), base, anchors)
    assert document(later, base) == before


def test_an_addition_takes_in_what_is_detected_where_it_was_corrected_to():
    base, events = measured(), MapEvents()
    taken(events, base, [Edit("add", label="chair", place_m=(9.0, 9.0))])
    assert len(events.shown(base)) == len(MEASURED) + 1
    events.take(Edit("correct", "chair-added-1", place_m=(1.1, 2.0)), base, anchors)
    assert "chair-1" not in [item.id for item in events.shown(base)]
    assert events.merges(base) == {"chair-1": "chair-added-1"}
    events.take(Edit("undo", "chair-added-1"), base, anchors)  # back where it was added, and nothing is there
    assert {"chair-1", "chair-added-1"} <= {item.id for item in events.shown(base)}


def test_what_a_person_added_stays_in_later_runs_whatever_is_detected_there():
    base, events = measured(), MapEvents()
    taken(events, base, [Edit("add", label=label, place_m=(1.0, 2.0), yaw_rad=0.5) for label in ("robot", "lamp")])
    taken(events, base, [Edit("name", "robot-added-1", name="Rex"), Edit("delete", "lamp-added-2")])
    shown, notes = events.shown(base), events.annotations(base)
    later, again = FloorMap().continued(notes.measured(shown)), MapEvents.of(shown, notes)
    assert document(again, later) == document(events, base)
    again.take(Edit("undo", "lamp-added-2"), later, anchors)
    assert again.take(Edit("add", label="lamp", place_m=(1.0, 2.0)), later, anchors) == "lamp-added-3"
    assert {"robot-added-1", "lamp-added-2", "lamp-added-3", "chair-1"} <= {one.id for one in again.shown(later)}


def test_edits_of_this_run_turn_into_the_saved_maps_frame():
    base, events = measured(), MapEvents()
    taken(events, base, [
        Edit("correct", "chair-1", place_m=(1.0, 0.0), yaw_rad=0.5), Edit("correct", "tv-1", yaw_rad=0.25),
        Edit("dock", pose=(2.0, 0.0, 0.0)), Edit("zone", name="hall", corners_m=SQUARE),
    ])  # fmt: skip
    events.enter([], Annotations(dock=SE2(9.0, 9.0, 0.0)), SE2(1.0, 0.0, np.pi / 2))
    shown = {item.id: item for item in events.shown(base)}
    assert shown["chair-1"].position_m == pytest.approx([1.0, 1.0])
    assert shown["chair-1"].yaw_rad == pytest.approx(0.5 + np.pi / 2)
    assert shown["tv-1"].yaw_rad == pytest.approx(0.25 + np.pi / 2)
    annotations = events.annotations(base)
    assert annotations.dock.vector() == pytest.approx([1.0, 2.0, np.pi / 2])
    assert np.array(annotations.zones[0].corners_m) == pytest.approx(np.array([(1.0, 0.0), (1.0, 2.0), (0.0, 2.0)]))


@given(st.lists(EDITS, max_size=8))
@settings(max_examples=60, deadline=None)
def test_a_loop_closure_that_moves_nothing_changes_no_edit(edits):
    base, events = measured(), MapEvents()
    taken(events, base, edits)
    before = document(events, base)
    events.moved(TrajectoryCorrection(np.zeros(1), np.zeros((1, 3))))
    assert document(events, base) == before
    events.enter([], Annotations(), SE2())
    assert document(events, base) == before


def test_a_zone_moves_as_one_piece():
    base, events = measured(), MapEvents()
    taken(events, base, [Edit("zone", name="hall", corners_m=SQUARE)])
    moves = np.array([[0.0, 1.0, 0.3], [20.0, 9.0, 0.0], [0.0, 0.0, 1.0]])  # one for each corner, by `anchors`
    events.moved(TrajectoryCorrection(np.arange(3.0), moves))
    moved_m = SE2(0.0, 1.0, 0.3).apply(np.array(SQUARE))
    assert np.array(events.annotations(base).zones[0].corners_m) == pytest.approx(moved_m)
