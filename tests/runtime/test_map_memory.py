"""What a map remembers over runs: which map it is, when its objects were seen, and what became of them."""

from dataclasses import replace

import numpy as np
import pytest
from support.drives import exact, observed, sighted
from support.rooms import mapped

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step import wall_clock
from edgemap.runtime.step.map_file import load_annotated_map, save_map
from edgemap.runtime.step.map_memory import MapMemory
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap
from edgemap.runtime.step.wall_clock import ClockReading, WallClock, stream_clock

NOON = 1.8e9
FREE_FLOOR = OccupancyGrid(np.full((200, 200), -60, np.int8), -5.0, -5.0, 0.05)


@pytest.mark.parametrize(
    ("readings", "wall"),
    [
        ([(0.0, 50.0, None), (9.0, 59.0, None)], {5.0: None}),  # never set
        ([(0.0, 50.0, None), (9.0, 59.0, NOON + 9.0)], {0.0: NOON, 9.0: NOON + 9.0}),  # set on the way
        ([(0.0, 50.0, NOON), (9.0, 59.0, NOON + 3600.0)], {0.0: NOON + 3591.0, 9.0: NOON + 3600.0}),  # a step
        ([(0.0, 50.0, NOON), (9.0, 859.0, NOON + 809.0)], {0.0: NOON, 9.0: NOON + 809.0}),  # suspended for 800 s
        ([(0.0, 50.0, NOON), (9.0, 59.0, None)], {9.0: NOON + 9.0}),  # no longer known to be right
    ],
)
def test_wall_time_of_stamps(readings, wall):
    clock = WallClock()
    for stamp_s, elapsed_s, utc_s in readings:
        clock.note(stamp_s, ClockReading(elapsed_s, utc_s))
    assert {stamp_s: clock.utc(stamp_s) for stamp_s in wall} == wall


@pytest.mark.parametrize(("stamp_s", "utc_s"), [(12.5, None), (1.305e9, 1.305e9), (1.3e18, None)])
def test_the_wall_time_of_a_file_is_in_its_stamps_or_unknown(stamp_s, utc_s):
    assert stream_clock(False, stamp_s).utc_s == utc_s


@pytest.mark.parametrize(
    ("now_s", "synchronised", "hardware", "restored", "known"),
    [
        (NOON, True, False, True, True),
        (NOON, False, True, True, True),
        (NOON, False, False, False, True),
        (NOON, False, False, True, False),  # booted with the time of the last shutdown
        (5.0, True, True, False, False),  # 1970
    ],
)
def test_whether_the_hosts_clock_is_set(monkeypatch, tmp_path, now_s, synchronised, hardware, restored, known):
    class Library:
        def adjtimex(self, _):
            return 0 if synchronised else 5

    monkeypatch.setattr(wall_clock.time, "time", lambda: now_s)
    monkeypatch.setattr(wall_clock.ctypes, "CDLL", lambda _: Library())
    monkeypatch.setattr(wall_clock, "_has_hardware_clock", lambda: hardware)
    monkeypatch.setattr(wall_clock, "RESTORED", (tmp_path if restored else tmp_path / "none",))
    assert wall_clock.host_clock().utc_s == (now_s if known else None)


def drive(mapper, things, utc_s, frames=20, start_s=0):
    """Frames from one place, 10 a second, at a wall time; None: of a host without a clock."""
    random = np.random.default_rng(0)
    for index in range(start_s * 10, start_s * 10 + frames):
        stamp_s = index / 10.0
        mapper.memory.clock.note(stamp_s, ClockReading(stamp_s, None if utc_s is None else utc_s + stamp_s))
        mapper.step(observed(index, sighted(things, SE2(), index, random), exact([SE2()])[0]))
    return mapper.objects()


def test_times_are_right_over_boots_with_and_without_a_clock(tmp_path):
    """The stream of each boot begins at 0 s, as a webcam's does."""
    path, seen = tmp_path / "map.json", []
    for boot, utc_s in enumerate([NOON, None, NOON + 7200.0]):
        mapper = Mapper()
        if boot:
            mapper.start_in(SavedMap(*load_annotated_map(path)), SE2())
        drive(mapper, [("chair", 2.0, 0.0)], utc_s, start_s=500 - 200 * boot)
        save_map(path, mapper.objects(), mapper.annotations())
        (chair,), annotations = load_annotated_map(path)
        seen.append((chair.first_seen, chair.last_seen, chair.history[0].what, annotations.identity.generation))
        assert chair.first_seen_s <= chair.last_seen_s
    first, last = NOON + 500.0, NOON + 7302.0
    assert seen == [(first, first + 2.0, "appeared", 1), (first, None, "appeared", 2), (first, last, "appeared", 3)]
    assert [event.what for event in chair.history] == ["appeared", "restored"]


@pytest.mark.parametrize(
    ("places_m", "since"),
    [
        ((2.0, 2.0, 2.0), 0.0),
        ((2.0, None, 2.0), 200.0),  # it may have been away in the run that did not observe it
        ((2.0, None, None), 0.0),  # until it was last observed
        ((2.0, 2.0, 2.8), None),  # it may be another chair
    ],
)
def test_since_when_it_stands_there_is_what_each_run_between_has_observed(tmp_path, places_m, since):
    for boot, x_m in enumerate(places_m):
        mapper, things = Mapper(), [("couch", 3.0, 2.0), *([("chair", x_m, 0.0)] if x_m else [])]
        if boot:
            mapper.start_in(SavedMap(*load_annotated_map(tmp_path)), SE2())
        drive(mapper, things, NOON + 100.0 * boot)
        save_map(tmp_path / "map.json", mapper.objects(), mapper.annotations())
    chair, couch = load_annotated_map(tmp_path)[0]
    assert (chair.label, chair.since and chair.since - NOON, couch.since) == ("chair", since, NOON)


def test_an_older_map_gets_an_id_of_its_content_and_keeps_it(tmp_path):
    save_map(tmp_path / "map.json", mapped([("chair", 2.0, 0.0)]))
    objects, annotations = load_annotated_map(tmp_path)
    assert "map_id" not in (tmp_path / "map.json").read_text()
    assert annotations.identity == load_annotated_map(tmp_path)[1].identity
    assert (objects[0].first_seen, objects[0].history) == (None, ())
    mapper = Mapper()
    mapper.start_in(SavedMap(objects, annotations), SE2())
    identity = mapper.annotations().identity
    assert (identity.map_id, identity.generation) == (annotations.identity.map_id, 2)


def remembering(saved, grid=FREE_FLOOR):
    memory = MapMemory()
    memory.clock.note(0.0, ClockReading(0.0, NOON))
    memory.enter(
        SavedMap([replace(item, first_seen=NOON - 99.0, last_seen=NOON - 50.0) for item in saved], NO, grid), {}
    )
    memory.begin(10.0, FREE_FLOOR)
    memory.annotated(saved, {})
    return memory


NO = Mapper().annotations()
ROOM = mapped([("chair", 1.0, 0.0), ("couch", 3.0, 2.0)])
OTHER = replace(ROOM[0], id="chair-9")
MOVED = replace(mapped([("chair", -2.0, 3.0)])[0], id="chair-2", first_seen_s=9.0, last_seen_s=10.0)


@pytest.mark.parametrize(
    ("saved", "shown", "sighted", "grid", "moves"),
    [
        (ROOM, [ROOM[1], MOVED], [], FREE_FLOOR, True),
        (ROOM, [ROOM[1], MOVED], [], None, False),  # was it there before?
        (ROOM, [ROOM[1], MOVED, replace(MOVED, id="chair-3")], [], FREE_FLOOR, False),  # which one?
        ([*ROOM, OTHER], [ROOM[1], OTHER, MOVED], [], FREE_FLOOR, False),  # the other one's place was not looked at
        ([*ROOM, OTHER], [ROOM[1], OTHER, MOVED], ["chair-9"], FREE_FLOOR, True),
    ],
)  # fmt: skip
def test_what_vanished_and_came_elsewhere_is_moved_where_nothing_else_explains_it(saved, shown, sighted, grid, moves):
    memory = remembering(saved, grid)
    memory.sighted(sighted)
    memory.annotated(shown, {})
    chair = next(item for item in memory.annotated(shown, {}) if item.id == "chair-2")
    gone = memory.annotations(NO).vanished
    if not moves:
        assert [event.what for event in chair.history] == ["appeared"]
        assert [item.id for item in gone] == ["chair-1"]
        assert gone[0].history[-1].what == "vanished"
        return
    (moved,) = chair.history
    assert (moved.what, moved.other, moved.from_m, moved.to_m) == ("moved", "chair-1", (1.0, 0.0), (-2.0, 3.0))
    assert (moved.at, chair.first_seen, chair.last_seen, gone) == (NOON + 9.0, NOON - 99.0, NOON + 10.0, ())
    again = [*saved, MOVED]
    memory.annotated(again, {})  # it was there all the time
    chair = next(item for item in memory.annotated(again, {}) if item.id == "chair-2")
    assert ([event.what for event in chair.history], chair.first_seen) == (["appeared"], NOON + 9.0)


def test_what_was_missed_is_moved_once_its_place_is_seen_to_be_free():
    memory = remembering(ROOM)
    memory.begin(11.0, None)
    memory.annotated([ROOM[1], MOVED], {})
    assert memory.annotations(NO).vanished[0].history[-1].what == "missed"
    memory.begin(12.0, FREE_FLOOR)
    memory.annotated([ROOM[1], MOVED, OTHER], {})  # which one of the two?
    assert memory.annotations(NO).vanished[0].history[-1].what == "vanished"
    memory.annotated([ROOM[1], MOVED], {})
    memory.annotated([ROOM[1], MOVED], {})
    shown = memory.annotated([ROOM[1], MOVED], {})
    assert [event.what for event in shown[1].history] == ["moved"]


def test_what_was_moved_may_leave_before_the_first_one_is_back():
    memory = remembering(ROOM)
    for shown in ([ROOM[1], MOVED], [ROOM[1], MOVED], [ROOM[1]], ROOM):
        objects = memory.annotated(shown, {})
    assert [(item.id, item.earlier) for item in objects] == [("chair-1", True), ("couch-1", True)]
    (gone,) = memory.annotations(NO).vanished
    assert (gone.id, [event.what for event in gone.history]) == ("chair-2", ["appeared", "vanished"])


def test_what_is_there_under_a_new_id_has_not_vanished():
    memory = remembering(ROOM)
    new = replace(ROOM[0], id="chair-7", first_seen_s=9.0, last_seen_s=10.0, position_m=np.array([1.05, 0.0]))
    memory.annotated([ROOM[1], new], {})
    chair = next(item for item in memory.annotated([ROOM[1], new], {}) if item.id == "chair-7")
    assert (chair.first_seen, chair.last_seen, chair.earlier) == (NOON - 99.0, NOON + 10.0, False)
    assert memory.annotations(NO).vanished == ()


def test_a_persons_edits_and_a_shift_are_in_the_history_and_a_loop_closure_is_not():
    memory = remembering([])
    chair = replace(mapped([("chair", 0.0, 0.0)])[0], covariance_m2=np.eye(2) * 1e-3)
    memory.annotated([chair], {})
    memory.edited(Edit("name", "chair-1", name="mine"), "chair-1")
    shifted = replace(chair, position_m=np.array([0.4, 0.0]))
    memory.annotated([shifted], {})
    memory.corrected()
    (shown,) = memory.annotated([replace(chair, position_m=np.array([2.0, 0.0]))], {})
    assert [(event.what, event.by) for event in shown.history] == [
        ("appeared", "sensor"), ("named", "person"), ("moved", "sensor"),
    ]  # fmt: skip


def test_the_id_of_what_has_vanished_is_not_given_again():
    gone = Annotations(vanished=tuple(mapped([("chair", 9.0, 9.0)])))
    for saved, *start in ((SavedMap([], gone), SE2()), (SavedMap(ROOM[1:], gone),)):
        mapper = Mapper()
        mapper.start_in(saved, *start) if start else mapper.relocalise_in(saved)
        assert [item.id for item in drive(mapper, [("chair", 2.0, 0.0)], NOON)] == ["chair-2"]
