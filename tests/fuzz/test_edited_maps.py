"""Random edits, set poses, zones, starts and damaged files between the steps of a drive: every saved map reads back,
and none is larger than what was seen."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support.boxed_room import CAMERA, floor_mask, walls
from support.drives import exact, observed, round_trip, sighted
from support.fuzzed_room import fuzz
from support.mutations import mutated_json, refused_or

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.events import Edit, EditError
from edgemap.geometry.objects.forgetting import Forgetter
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.edit_queue import Edits, load_edits
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, map_document, replace_map, save_map, saved_text
from edgemap.runtime.step.mapper import WIDEST_M, Mapper
from edgemap.runtime.step.relocalisation import SavedMap

LENGTH = 50  # actions of one drive
BOX = walls(0.0, 0.0, 8.0, 6.0)
ROOM = [
    ("chair", 1.0, 1.0), ("chair", 7.0, 5.0), ("bed", 1.5, 4.5), ("table", 6.5, 1.0), ("tv", 4.0, 5.7),
    ("chair", 4.0, 0.5), ("plant", 7.6, 3.0), ("plant", 0.4, 3.0),
]  # fmt: skip
POSES = round_trip(40)
MASKS = [floor_mask(BOX, pose) for pose in POSES]
SEEN_M = 20.0  # beyond a pose: what is in view there, and the margin of the grid

ODD = (0.0, 20.0, -49.0, 49.0, 51.0, -400.0, 1e3, 1e6, -1e6, 1e9, 1e308, math.nan, math.inf, -math.inf, 5e-324)
number = st.floats(-10.0, 10.0) | st.sampled_from(ODD)
place = st.tuples(number, number)
pose = st.tuples(number, number, number)
text = st.text(max_size=4) | st.sampled_from(("", "chair", "bed", " ", "\0", "a" * 81, "\u202e", "\ud800", "=1+1"))
PIECES = ("chair-1", "chair-2", "bed-1", "table-1", "plant-1", "tv-1", "chair-added-1")
identity = st.sampled_from((*PIECES, "zone-1", "zone-2", "dock", "", "x"))
edit = st.one_of(
    st.builds(Edit, st.just("pose"), pose=pose, sigmas=st.none() | st.tuples(number, number, number)),
    st.builds(Edit, st.just("dock"), pose=pose),
    st.builds(Edit, st.just("zone"), st.just("") | identity, text, corners_m=st.lists(place, max_size=5).map(tuple)),
    st.builds(Edit, st.just("name"), identity, text),
    st.builds(Edit, st.sampled_from(("confirm", "delete", "undo")), identity, on=st.booleans()),
    st.builds(Edit, st.just("merge"), identity, into=identity),
    st.builds(
        Edit, st.sampled_from(("correct", "add")), identity, label=text, place_m=st.none() | place,
        size_m=st.none() | st.tuples(number, number, number), yaw_rad=st.none() | number,
    ),
)  # fmt: skip
action = st.one_of(
    st.tuples(st.just("drive"), st.integers(1, 5)),
    st.tuples(st.just("edit"), edit),
    st.tuples(st.just("save"), st.booleans()),
    st.tuples(st.just("start"), pose | st.sampled_from(("search", "continue"))),
    st.tuples(st.just("damage"), st.none()),
)


class Edited:
    """A robot that drives round a room while people edit its map. folder: where it is saved. draw: of hypothesis."""

    def __init__(self, folder, draw):
        self.folder, self.draw, self.count, self.damaged = folder, draw, 0, False
        self.random = np.random.default_rng(0)
        self.mapper = Mapper(forgetter=Forgetter(CAMERA))
        self.edits = Edits(folder / "edits.jsonl")
        self.save(True)

    def drive(self, steps):
        """Some pictures more."""
        for _ in range(steps):
            index, last = self.count % len(POSES), (self.count - 1) % len(POSES)
            motion = exact([POSES[last], POSES[index]])[1]
            seen = observed(self.count, sighted(ROOM, POSES[index], self.count, self.random), motion)
            update = self.mapper.step(replace(seen, camera=CAMERA, floor=MASKS[index]))
            assert np.isfinite(update.pose_map_base.vector()).all()
            self.count += 1

    def edit(self, asked):
        """An edit by a person, which is applied or refused."""
        future = self.edits.submit(asked)
        assert self.edits.apply(self.mapper, self.count) == []
        assert future.exception() is None or isinstance(future.exception(), EditError)

    def save(self, last_pose):
        """Save as a run's end does, and read it again."""
        mapper, path = self.mapper, self.folder / "map.json"
        objects, annotations, grid = mapper.objects(), mapper.annotations(), mapper.grid.grid()
        save_map(path, objects, annotations, grid)
        if last_pose:
            replace_map(path, saved_text(map_document(objects, annotations, grid, last_pose=mapper.pose_map_base)))
        read, notes = load_annotated_map(self.folder)
        assert [item.id for item in read] == [item.id for item in objects]
        assert [zone.id for zone in notes.zones] == [zone.id for zone in annotations.zones]
        assert (load_annotated_map(path)[1].last_pose is not None) == last_pose
        floor = load_grid(self.folder)
        assert (floor is None) == (grid is None)
        if floor is not None:
            assert max(floor.log_odds.shape) * floor.cell_m < 2 * WIDEST_M + SEEN_M or self.damaged

    def start(self, where):
        """Go on in the saved map, as another run does."""
        saved = SavedMap(*load_annotated_map(self.folder), load_grid(self.folder))
        mapper = Mapper(forgetter=Forgetter(CAMERA))
        if where == "search":
            mapper.relocalise_in(saved)
        elif where == "continue":
            mapper.continue_map(saved)
        else:
            try:
                mapper.start_in(saved, SE2(*where))
            except MapError:
                return
        self.mapper = mapper

    def damage(self, _):
        """Another run goes on in the saved map with values of it changed, where that is read."""
        path, other = self.folder / "map.json", Edited.__new__(Edited)
        path.with_name("other").mkdir(exist_ok=True)
        changed = self.draw(mutated_json(json.loads(path.read_bytes())))
        (path.with_name("other") / "map.json").write_bytes(changed)
        vars(other).update(vars(self) | {"folder": path.with_name("other"), "mapper": None, "damaged": True})
        if refused_or(load_annotated_map, other.folder) is None:
            return
        try:
            other.start("continue")
        except MapError:
            return
        other.drive(3)
        other.save(True)


@fuzz(LENGTH)
@given(st.lists(action, min_size=LENGTH, max_size=LENGTH), st.data())
def test_whatever_people_do_the_saved_map_reads_back(tmp_path_factory, actions, data):
    folder = tmp_path_factory.mktemp("map", numbered=True)
    edited = Edited(folder, data.draw)
    for what, value in actions:
        getattr(edited, what)(value)
    edited.save(True)
    if (folder / "edits.jsonl").exists():
        load_edits(folder / "edits.jsonl")
    shutil.rmtree(folder)
