"""The occupancy grid from floor masks of a room of boxes: places by hand, and properties that any drive has."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.boxed_room import CAMERA, area_m2, depth_picture, floor_mask, walls

from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.grid.fusion import GridFusion
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from edgemap.geometry.grid.patch import after
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.step.grid_file import save_grid

NOBODY = np.zeros((0, 4))
ROOM = walls(-1.0, -2.0, 4.0, 2.0)
CHAIR = (2.0, -0.25, 2.5, 0.25, 0.8)


def drive(fusion, boxes, poses, start_s=0.0, movers=NOBODY, rate_hz=10.0):
    """Observe these boxes from poses, one after the other; the next stamp."""
    masks = {pose: floor_mask(boxes, pose) for pose in dict.fromkeys(poses)}
    for index, pose in enumerate(poses):
        fusion.observe(pose, start_s + index / rate_hz, CAMERA, masks[pose], movers, NOBODY)
    return start_s + len(poses) / rate_hz


def turn(x_m=0.0, y_m=0.0, steps=60):
    """Once round on the spot."""
    return [SE2(x_m, y_m, math.tau * k / steps) for k in range(steps)]


def settled(fusion, stamp_s, pose):
    """Its grid once a correction is drawn."""
    for _ in range(50):
        fusion.observe(pose, stamp_s, CAMERA, None, NOBODY, NOBODY)
    return fusion.grid()


def occupied_m(grid):
    """Middles of occupied cells."""
    return grid.centres_m(grid.cells == OCCUPIED)


def test_floor_is_free_walls_and_a_chair_are_occupied_and_what_is_behind_them_is_unknown():
    fusion = GridFusion()
    drive(fusion, [*ROOM, CHAIR], turn())
    grid = fusion.grid()
    assert (grid.at([(1.0, 0.0), (1.5, 1.0), (1.5, -1.0), (0.0, 0.0), (-0.6, 0.5)]) == FREE).all()
    assert (grid.at([(3.2, 0.0), (2.9, 0.1), (5.0, 0.0), (0.0, 2.6), (2.3, 0.0)]) == UNKNOWN).all()
    assert np.abs(occupied_m(grid) - [2.0, 0.0]).sum(axis=1).min() < 0.06  # the chair's front
    for point, normal in (((0.0, 2.0), 1), ((0.0, -2.0), 1), ((-1.0, 0.0), 0)):
        near = occupied_m(grid)[np.abs(occupied_m(grid)[:, 1 - normal] - point[1 - normal]) < 0.5]
        assert np.abs(near[:, normal] - point[normal]).min() < 0.06, point


def test_what_looks_like_floor_in_a_detections_box_is_not_free_until_it_is_seen_without_one():
    fusion, pose = GridFusion(), SE2()
    mask = floor_mask(ROOM, pose)
    (middle_px,) = CAMERA.project([(1.0, 0.0, 0.0)])
    box = np.array([[*(middle_px - 12.0), *(middle_px + 12.0)]])
    for index in range(12):
        fusion.observe(pose, 0.5 * index, CAMERA, mask, NOBODY, box)
    assert fusion.grid().at([(1.0, 0.0)]) == UNKNOWN
    assert (fusion.grid().at([(1.0, 0.3), (1.5, -0.6)]) == FREE).all()
    drive(fusion, ROOM, [pose] * 12, start_s=6.0, rate_hz=2.0)
    assert fusion.grid().at([(1.0, 0.0)]) == FREE


def test_a_chair_that_is_taken_away_leaves_no_ghost_within_seconds_even_of_a_robot_at_rest():
    fusion = GridFusion()
    stamp_s = drive(fusion, [*ROOM, CHAIR], [SE2(0.3, 0.0, 0.0)] * 600)  # a minute: as sure as it gets
    front = occupied_m(fusion.grid())
    front = front[(np.abs(front[:, 1]) < 0.3) & (front[:, 0] < 2.6)]
    assert len(front) >= 8
    stamp_s = drive(fusion, ROOM, [SE2(0.3, 0.0, 0.0)] * 80, stamp_s)
    assert (fusion.grid().at(front) == FREE).all()
    drive(fusion, [*ROOM, CHAIR], [SE2(0.3, 0.0, 0.0)] * 30, stamp_s)
    assert (fusion.grid().at(front) == OCCUPIED).mean() > 0.8  # and it may come back


def test_people_make_no_obstacle_and_the_same_shape_without_their_box_does():
    where = SE2(0.5, 0.0, 0.0)
    blob = (1.8, -0.2, 2.1, 0.2, 1.7)
    pixels = CAMERA.project(np.array([[1.3, 0.25, 0.0], [1.3, -0.25, 0.0], [1.6, 0.0, 1.7]]))
    box = np.array([[*pixels.min(axis=0), *pixels.max(axis=0)]])
    for movers, obstacle in ((box, False), (NOBODY, True)):
        fusion = GridFusion()
        drive(fusion, [*ROOM, blob], [where] * 40, movers=movers)
        near = np.abs(occupied_m(fusion.grid()) - [1.8, 0.0]).max(axis=1) < 0.25
        assert near.any() == obstacle


def test_depth_alone_fills_the_grid_and_knows_what_stands_on_floor_that_looks_the_same():
    """A shoe, 12 cm high, that the mask takes for floor, is an obstacle by its depth; a mat is not."""
    shoe, mat = (1.5, 0.0, 1.8, 0.2, 0.12), (1.0, -0.35, 1.3, -0.05, 0.02)
    where = [SE2(0.1 * k, 0.0, 0.0) for k in range(6)] * 4
    with_depth, by_mask = GridFusion(), GridFusion()
    for index, pose in enumerate(where):
        depth = SparseDepth.of(depth_picture([*ROOM, shoe, mat], pose))
        with_depth.observe(pose, index / 2, CAMERA, floor_mask(ROOM, pose), NOBODY, NOBODY, depth)
        by_mask.observe(pose, index / 2, CAMERA, floor_mask(ROOM, pose), NOBODY, NOBODY)
    assert by_mask.grid().at([(1.65, 0.1)])[0] == FREE
    at_shoe = with_depth.grid().at([(1.525, 0.1), (1.575, 0.1), (1.625, 0.1)])
    assert (at_shoe == OCCUPIED).any()
    assert (with_depth.grid().at([(1.15, -0.2), (1.5, -0.3)]) == FREE).all()  # a mat of 2 cm is floor
    alone = GridFusion()
    for index, pose in enumerate(where):
        alone.observe(pose, index / 2, CAMERA, None, NOBODY, NOBODY, SparseDepth.of(depth_picture([*ROOM, shoe], pose)))
    assert area_m2(alone.grid(), FREE) > 2.0


@pytest.mark.parametrize("rate_hz", [5.0, 30.0])
def test_evidence_counts_places_and_time_not_pictures(rate_hz):
    """One metre at 0.4 m/s and five seconds at rest: the same floor, and the same chair, are known at any rate."""
    areas, fronts = [], []
    for rate in (10.0, rate_hz):
        fusion = GridFusion()
        poses = [SE2(0.4 * k / rate, 0.0, 0.0) for k in range(int(2.5 * rate))]
        drive(fusion, [*ROOM, CHAIR], [*poses, *[poses[-1]] * int(5 * rate)], rate_hz=rate)
        areas.append(area_m2(fusion.grid(), FREE))
        fronts.append(int((np.abs(occupied_m(fusion.grid()) - [2.0, 0.0]).max(axis=1) < 0.3).sum()))
    assert areas[1] == pytest.approx(areas[0], rel=0.1)
    assert min(fronts) >= 8
    assert fronts[1] == pytest.approx(fronts[0], rel=0.35)


def test_a_correction_moves_what_was_seen_with_the_poses_it_was_seen_from():
    """Seen from poses 0.3 m too far left, then put right: the grid is that of a drive with the right poses."""
    wrong, right = GridFusion(), GridFusion()
    poses, off = [SE2(0.04 * k, 0.0, 0.0) for k in range(40)], SE2(0.0, 0.3, 0.0)
    for index, pose in enumerate(poses):
        mask = floor_mask([*ROOM, CHAIR], pose)
        right.observe(pose, index / 10, CAMERA, mask, NOBODY, NOBODY)
        wrong.observe(off @ pose, index / 10, CAMERA, mask, NOBODY, NOBODY)
    stamps = np.arange(0, 40, 5) / 10
    moves = np.tile([0.0, -0.3, 0.0], (len(stamps), 1))
    wrong.moved(TrajectoryCorrection(stamps, moves))
    after_it = settled(wrong, 4.0, poses[-1])
    true = settled(right, 4.0, poses[-1])
    points = np.concatenate([true.centres_m(true.cells == FREE), occupied_m(true)])
    assert (after_it.at(points) == true.at(points)).mean() > 0.97
    assert area_m2(after_it, OCCUPIED) == pytest.approx(area_m2(true, OCCUPIED), rel=0.15)


def test_a_run_goes_on_in_a_saved_grid_and_sees_its_changes():
    first, second = GridFusion(), GridFusion()
    drive(first, [*ROOM, CHAIR], turn())
    second.continue_from(first.grid())
    start = settled(second, 0.0, SE2(-0.5, -1.5, 2.0))
    assert (start.at([(1.0, 0.0), (1.5, 1.0)]) == FREE).all()
    assert np.abs(occupied_m(start) - [2.0, 0.0]).max(axis=1).min() < 0.06
    drive(second, ROOM, [SE2(0.3, 0.0, 0.0)] * 120, 1.0)
    assert (second.grid().at([(2.0, 0.0), (2.05, 0.1)]) == FREE).all()


def test_a_run_that_finds_itself_lays_its_floor_into_the_saved_one():
    saved, own = GridFusion(), GridFusion()
    drive(saved, [*ROOM, CHAIR], turn())
    pose_map_start = SE2(0.5, 1.0, -0.7)  # where in the saved map this run began
    for index, pose in enumerate(turn(0.5, 1.0)):
        mask = floor_mask([*ROOM, CHAIR], pose)
        own.observe(pose_map_start.inverse() @ pose, index / 10, CAMERA, mask, NOBODY, NOBODY)
    own.transform(pose_map_start)
    own.continue_from(saved.grid())
    grid = settled(own, 6.0, SE2(0.5, 1.0, 0.0))
    outside = (np.abs(occupied_m(grid) - [1.5, 0.0]) > [2.71, 2.21]).any(axis=1)
    assert not outside.any()
    assert area_m2(grid, FREE) > area_m2(saved.grid(), FREE)


def test_an_office_of_500_square_metres_takes_less_than_20_mb(tmp_path):
    """Up and down a hall of 25 x 20 m, all of its floor seen, corrections as they come."""
    tracemalloc.start()
    hall, fusion, stamp_s = walls(0.0, 0.0, 25.0, 20.0), GridFusion(), 0.0
    for lane in range(8):
        y_m, heading = 1.3 + 2.5 * lane, math.pi * (lane % 2)
        for k in range(30):
            x_m = 0.5 + 0.8 * k if lane % 2 == 0 else 24.5 - 0.8 * k
            pose = SE2(x_m, y_m, heading)
            mask = floor_mask(hall, pose)
            for _ in range(2):
                fusion.observe(pose, stamp_s, CAMERA, mask, NOBODY, NOBODY)
                stamp_s += 0.5
        move = np.array([[0.04, 0.0, 0.0]])
        fusion.moved(TrajectoryCorrection(np.zeros(1), move))
        assert tracemalloc.get_traced_memory()[0] < 20e6
    tracemalloc.stop()
    grid = settled(fusion, stamp_s, SE2(0.5, 18.8, math.pi))
    assert area_m2(grid, FREE) > 240.0
    save_grid(tmp_path / "grid.npz", grid)
    assert (tmp_path / "grid.npz").stat().st_size < 1e6


steps = st.integers(-900, 900)


@given(st.lists(steps, max_size=8), st.lists(steps, max_size=8), st.integers(-500, 400))
def test_evidence_that_is_joined_does_what_its_parts_do_in_turn(first, second, start):
    low, high = -500, 400

    def function(added):
        values = np.array([[0], [low], [high]], np.int16)
        for step in added:
            values = after(values, np.array([[step], [low], [high]], np.int16))
        return values

    shift, least, most = after(function(first), function(second))
    x = start
    for step in (*first, *second):
        x = min(max(x + step, low), high)
    assert int(np.clip(start + int(shift[0]), least[0], most[0])) == x


@given(
    st.floats(0.4, 2.5), st.integers(1, 12), st.integers(1, 12), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0),
    st.integers(0, 99),
)  # fmt: skip
def test_each_cell_of_a_scaled_grid_takes_the_nearest_old_one(factor, rows, columns, x_m, y_m, seed):
    odds = np.random.default_rng(seed).integers(-100, 100, (rows, columns), dtype=np.int8)
    grid = OccupancyGrid(odds, x_m, y_m, 0.05)
    scaled = grid.scaled(factor)
    height, width = scaled.log_odds.shape
    assert (width * 0.05, height * 0.05) >= (columns * 0.05 * factor - 1e-6, rows * 0.05 * factor - 1e-6)
    for row in range(height):
        for column in range(width):
            x = ((column + 0.5) * 0.05 + scaled.x_m) / factor - x_m
            y = ((row + 0.5) * 0.05 + scaled.y_m) / factor - y_m
            near = [[int(np.clip(np.floor(at / 0.05 + e), 0, count - 1)) for e in (-1e-6, 1e-6)]
                    for at, count in ((y, rows), (x, columns))]  # fmt: skip
            assert scaled.log_odds[row, column] in odds[np.ix_(*near)]
