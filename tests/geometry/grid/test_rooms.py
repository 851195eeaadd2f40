"""Walls, rooms and doors of grids that are drawn by hand: lengths, places and areas are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import mapped, two_rooms

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import floor_parts
from edgemap.geometry.grid.walls import fit_walls, walls_of
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.rooms import room_called, rooms_of


def test_a_door_parts_two_rooms_and_a_wide_opening_does_not():
    rooms, (door,) = floor_parts(two_rooms(0.9))
    assert [room.area_m2 for room in rooms] == pytest.approx([12.0, 12.0], rel=0.08)
    assert np.ptp(rooms[0].corners_m, axis=0) == pytest.approx([3.0, 4.0], abs=0.25)
    x, y = np.array(rooms[0].corners_m).T
    assert x @ np.roll(y, -1) - y @ np.roll(x, -1) > 0.0  # counter-clockwise
    assert door.centre_m == pytest.approx([2.15, 4.1], abs=0.1)
    assert math.dist(door.from_m, door.to_m) == pytest.approx(0.9, abs=0.1)
    assert set(door.rooms) == {"1", "2"}
    assert door.open > 0.9
    assert [len(parts) for parts in floor_parts(two_rooms(3.0))] == [1, 0]


def test_little_floor_behind_a_door_is_a_room_and_specks_beyond_a_wall_extend_none():
    rooms, (door,) = floor_parts(two_rooms(0.9, 50))  # 2 m2 of the left one were seen
    assert [round(np.ptp(room.corners_m, axis=0)[0], 1) for room in rooms] == pytest.approx([0.6, 3.1], abs=0.15)
    assert door.centre_m == pytest.approx([2.15, 4.1], abs=0.1)
    odds = np.pad(two_rooms(0.9).log_odds, ((0, 0), (0, 40)))
    odds[20:23, 126:150] = -40
    right = floor_parts(OccupancyGrid(odds, -1.0, 2.0, 0.05))[0][1]
    assert np.ptp(right.corners_m, axis=0) == pytest.approx([3.0, 4.0], abs=0.25)


def test_a_wall_that_furniture_hides_may_part_a_room():
    odds = two_rooms(0.9).log_odds.copy()
    odds[:33, 55:72] = odds[51:, 55:72] = 0
    hidden = OccupancyGrid(odds, -1.0, 2.0, 0.05)
    assert [len(floor_parts(hidden, (), fine)[0]) for fine in (False, True)] == [1, 2]


@pytest.mark.parametrize("angle", [0.3, 1.2])
def test_rooms_turn_with_the_grid(angle):
    straight = two_rooms(0.9)
    c, s = np.cos(angle), np.sin(angle)
    x, y = np.meshgrid(np.arange(-160, 160) * 0.05 + 0.025, np.arange(-160, 160) * 0.05 + 0.025)
    there = np.column_stack([(x * c + y * s).ravel(), (y * c - x * s).ravel()])
    odds = (np.choose(straight.at(there).astype(int) // 100 + 1, [0, -40, 40])).astype(np.int8).reshape(320, 320)
    rooms, (door,) = floor_parts(OccupancyGrid(odds, -8.0, -8.0, 0.05))
    assert [room.area_m2 for room in rooms] == pytest.approx([12.0, 12.0], rel=0.1)
    assert np.array([c * 2.15 - s * 4.1, s * 2.15 + c * 4.1]) == pytest.approx(door.centre_m, abs=0.15)


def test_ids_and_names_stay_where_the_place_is_and_a_closed_door_stays_between_its_rooms():
    grid, bed = two_rooms(0.9), mapped([("bed", 3.5, 4.0), ("oven", 0.5, 3.0), ("chair", 1.0, 5.0)])
    first, doors = rooms_of(bed, NO_ANNOTATIONS, grid)
    assert [(room.id, room.kind, len(room.objects)) for room in first] == [
        ("room-1", "kitchen", 2), ("room-2", "bedroom", 1)
    ]  # fmt: skip
    known = Annotations(rooms=(first[1], replace(first[0], id="room-7", name="galley")), doors=doors)
    odds = grid.log_odds.copy()
    odds[33:51, 62:64] = 40  # somebody has closed the door
    rooms, (door,) = rooms_of(bed, known, replace(grid, log_odds=odds))
    assert [(room.id, room.name) for room in rooms] == [("room-2", ""), ("room-7", "galley")]
    assert (door.id, set(door.rooms)) == ("door-1", {"room-2", "room-7"})
    assert door.open < 0.1
    assert room_called(rooms, "Kitchen") is room_called(rooms, "galley") is rooms[1]
    assert room_called(rooms, "attic") is None
    wide, _ = rooms_of(bed, known, two_rooms(3.0))
    assert [room.name for room in wide] == ["galley"]  # named ones never go


def test_walls_have_the_rooms_lengths_and_stand_where_floor_ends():
    walls = walls_of(two_rooms(0.9))
    lengths = sorted((wall.length_m for wall in walls), reverse=True)
    assert lengths[:2] == pytest.approx([6.1, 6.1], abs=0.3)
    assert sorted(wall.from_m[1] for wall in walls[:2]) == pytest.approx([2.1, 6.1], abs=0.1)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 2.5])
def test_a_line_of_points_is_one_wall_at_any_angle_and_a_doorway_parts_it(angle):
    along, rng = np.array([np.cos(angle), np.sin(angle)]), np.random.default_rng(1)
    place = np.arange(-2.0, 2.0, 0.05)
    line = place[:, None] * along + rng.normal(0.0, 0.015, (len(place), 2))
    (wall,) = fit_walls(line, 0.05)
    assert wall.length_m == pytest.approx(4.0, abs=0.15)
    x, y = np.subtract(wall.to_m, wall.from_m) / wall.length_m
    assert abs(x * along[1] - y * along[0]) < 0.02
    parted = fit_walls(line[np.abs(place) > 0.45], 0.05)
    assert sorted(one.length_m for one in parted) == pytest.approx([1.55, 1.55], abs=0.15)
    assert fit_walls(line[:12], 0.05) == ()  # shorter than a wall
