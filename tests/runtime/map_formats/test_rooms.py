"""Walls and rooms of grids that are drawn by hand: lengths, places and areas are known."""

import numpy as np
import pytest

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.walls import fit_walls, walls_of
from edgemap.runtime.outputs.map_formats.rooms import rooms_of


def home(door_m: float, cut: int = 0) -> OccupancyGrid:
    """Two rooms of 3 x 4 m side by side along x, a wall of 10 cm with a door in its middle; the first `cut` columns
    were not seen."""
    odds = np.full((84, 126), 40, np.int8)
    odds[2:82, 2:62] = odds[2:82, 64:124] = -40
    half = round(door_m / 0.1)
    odds[42 - half : 42 + half, 62:64] = -40
    odds[:, :cut] = 0
    return OccupancyGrid(odds, -1.0, 2.0, 0.05)


def test_a_door_parts_two_rooms_and_a_wide_opening_does_not():
    rooms = rooms_of(home(0.9))
    assert [room.area_m2 for room in rooms] == pytest.approx([12.0, 12.0], rel=0.08)
    corners = np.array(rooms[0].corners_m)
    assert len(corners) <= 10
    assert np.ptp(corners, axis=0) == pytest.approx([3.0, 4.0], abs=0.25)
    x, y = corners.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))  # positive: counter-clockwise
    assert area == pytest.approx(rooms[0].area_m2, rel=0.05)
    assert len(rooms_of(home(2.0))) == 1


def test_what_was_seen_in_part_is_no_room():
    only = rooms_of(home(0.9, cut=22))
    assert len(only) == 1
    assert min(x for x, _ in only[0].corners_m) > 1.9  # the whole one


def test_walls_have_the_rooms_lengths_and_stand_where_floor_ends():
    walls = walls_of(home(0.9))
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
