"""Rooms and doors: the observed floor, cut along lines of wall that only narrow passages lead through.

The grid is turned so that its walls run along rows and columns. Its floor is then cut in two, and each part again,
along the row or column with the most wall and the least floor across it. A room is the rectangle around one part, up to
its cuts; a door is a passage through a cut.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import label, maximum_filter1d, minimum_filter1d

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.grid.walls import ASIDE_CELLS, SHORTEST_M

DOOR_M = (0.5, 1.6)  # width of the free cells in a door: they show a true width of 0.6 to 1.4 m to a cell or two
LEAST_M2 = 3.0  # observed floor of a room, but for one behind a door that was observed
SPECK_M2 = 1.0  # less floor that nothing connects is an error
PASSAGE = 0.75  # metres of wall in a cut that a metre of floor across it outweighs
JAMB = 0.3  # metres of wall that a passage between two ends of wall counts for
BEYOND_M = 1.2  # from a room's observed floor and objects to the cut that bounds it, at most
OBJECT_SHARE = 0.85  # of an object's radius: occupied cells there are the object, not wall

Mask = NDArray[np.bool_]
Point = tuple[float, float]
_Window = tuple[slice, slice]  # rows and columns of the lattice
_Cut = tuple[int, int, _Window]  # across a window, before a row (axis 0) or a column (axis 1): the axis, and which


@dataclass(frozen=True, slots=True)
class Room:
    """corners_m: outline, counter-clockwise, map frame. kind: by its objects, empty where none shows it. name: by a
    person. objects: ids of those in it."""

    id: str
    corners_m: tuple[Point, ...]
    kind: str = ""
    name: str = ""
    objects: tuple[str, ...] = ()

    @property
    def area_m2(self) -> float:
        """Area inside the outline."""
        return polygon_m2(self.corners_m)

    @property
    def centre_m(self) -> Array:
        """Mean of the corners (2,)."""
        return np.mean(self.corners_m, axis=0)


@dataclass(frozen=True, slots=True)
class Door:
    """An opening between two rooms, map frame. rooms: their ids. open: probability that one can walk through."""

    id: str
    from_m: Point
    to_m: Point
    rooms: tuple[str, str]
    open: float

    @property
    def centre_m(self) -> Array:
        """Middle of the opening (2,)."""
        return np.mean([self.from_m, self.to_m], axis=0)


class Disc(NamedTuple):
    """The floor that an object takes."""

    x_m: float
    y_m: float
    radius_m: float


class _Lines(NamedTuple):
    """Runs of free cells across each line: line, first and last cell (excluded), whether wall ends at both. wall: cells
    (lines, cells) of wall at each line."""

    line: NDArray[np.intp]
    first: NDArray[np.intp]
    last: NDArray[np.intp]
    jambs: Mask
    wall: Mask


def polygon_m2(corners_m: ArrayLike) -> float:
    """Area of a polygon (N, 2), metres."""
    x, y = np.asarray(corners_m).T
    return abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2.0


def inside(corners_m: ArrayLike, points_m: Array) -> Mask:
    """Which points (..., 2) lie in a polygon (K, 2): even-odd rule."""
    x, y, corners = points_m[..., 0], points_m[..., 1], np.asarray(corners_m, dtype=np.float64)
    within = np.zeros(x.shape, np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:
            within ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return within


@lru_cache(maxsize=2)
def floor_parts(
    grid: OccupancyGrid, discs: tuple[Disc, ...] = (), fine: bool = False
) -> tuple[tuple[Room, ...], tuple[Door, ...]]:
    """Rooms, the nearest to the map's origin first, and the doors between them; their ids are numbers. discs: of the
    objects, which stand on the floor of a room and are no wall. fine: parts of rooms, cut where furniture may hide one
    more wall."""
    cell_m, occupied = grid.cell_m, grid.cells == OCCUPIED
    if not occupied.any():
        return (), ()
    turn = _turn(grid.centres_m(occupied), cell_m)
    low_m, x_m, y_m = _lattice(grid, turn)
    cells = grid.at(np.stack(np.meshgrid(x_m, y_m), axis=-1).reshape(-1, 2) @ turn).reshape(len(y_m), len(x_m))
    placed = [(turn @ [disc.x_m, disc.y_m], disc.radius_m) for disc in discs]
    taken = np.zeros(cells.shape, np.bool_)
    for (x, y), radius_m in placed:
        taken |= np.square(x_m - x) + np.square(y_m - y)[:, None] < (OBJECT_SHARE * radius_m) ** 2
    part = _without_specks((cells == FREE) | (cells == OCCUPIED), cell_m)
    floor, occupied = part & (cells == FREE), part & (cells == OCCUPIED)
    windows, cuts = _cut_up(floor, floor | taken, occupied & ~taken, cell_m, fine)
    owner, from_origin_m = np.zeros(cells.shape, np.intp), np.hypot(x_m, y_m[:, None])
    parts = [(window, _without_specks(floor[window], cell_m)) for window in windows]
    parts.sort(key=lambda part: from_origin_m[part[0]][part[1]].min())
    near, rooms, doors = [(place_m - low_m, radius_m) for place_m, radius_m in placed], list[Room](), list[Door]()
    for number, (window, mine) in enumerate(parts, 1):
        owner[window][mine] = number
        rooms.append(Room(str(number), _points(_box(window, mine, near, cells.shape, cell_m) + low_m, turn)))
    for ends_m, sides in (door for cut in cuts for door in _doors(*cut, floor, occupied & ~taken, owner, cell_m)):
        from_m, to_m = _points(ends_m + low_m, turn)
        doors.append(Door(str(len(doors) + 1), from_m, to_m, sides, passable(grid, from_m, to_m)))
    return tuple(rooms), tuple(doors)


def passable(grid: OccupancyGrid, from_m: ArrayLike, to_m: ArrayLike) -> float:
    """Probability that one can walk through an opening: the median over its width, by the cells that are most likely
    occupied across it."""
    ends, steps = np.array([from_m, to_m]), np.linspace(0.1, 0.9, 9)
    along = ends[1] - ends[0]
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    offsets = np.arange(-ASIDE_CELLS, ASIDE_CELLS + 1)[:, None] * grid.cell_m * across
    points = ends[0] + steps[:, None, None] * along + offsets
    blocked = grid.occupancy(points.reshape(-1, 2)).reshape(points.shape[:2]).max(axis=1)
    return float(1.0 - np.median(blocked))


def _without_specks(mask: Mask, cell_m: float) -> Mask:
    """The connected parts that are no error."""
    parts, count = cast(tuple[NDArray[np.int32], int], label(mask))
    large = np.bincount(parts.ravel(), minlength=count + 1) * cell_m**2 >= SPECK_M2
    large[0] = False
    return large[parts]


def _points(points_m: Array, turn: Array) -> tuple[Point, ...]:
    """Points (N, 2) of the turned frame in the map frame."""
    return tuple((float(x), float(y)) for x, y in points_m @ turn)


def _turn(points_m: Array, cell_m: float) -> Array:
    """Rotation (2, 2) after which walls run along x and y: the one after which points fall into the fewest rows and
    columns."""
    thinned = points_m[:: 1 + len(points_m) // 800]
    quarters = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * (cell_m / 4.0)  # a cell is a square, not a point
    points = (thinned[:, None] + quarters).reshape(-1, 2)

    def rotation(angle: float) -> Array:
        return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])

    def sharpness(angle: float) -> float:
        bins = np.rint(points @ rotation(angle).T / cell_m).astype(np.intp)
        return sum(float(np.square(np.bincount(axis - axis.min())).sum()) for axis in bins.T)

    return rotation(max(np.radians(np.arange(90)).tolist(), key=sharpness))


def _lattice(grid: OccupancyGrid, turn: Array) -> tuple[Array, Array, Array]:
    """Lower corner (2,) of a lattice that covers the turned grid, x of its columns, and y of its rows, at the middles
    of the cells."""
    cell_m, (rows, columns) = grid.cell_m, grid.cells.shape
    ends = np.array([[x, y] for x in (0, columns) for y in (0, rows)]) * cell_m + [grid.x_m, grid.y_m]
    corners = ends @ turn.T
    low = corners.min(axis=0) - cell_m
    counts = np.ceil(np.ptp(corners, axis=0) / cell_m).astype(int) + 2
    x_m, y_m = (start + (np.arange(count) + 0.5) * cell_m for start, count in zip(low, counts, strict=True))
    return low, x_m, y_m


def _cut_up(floor: Mask, through: Mask, wall: Mask, cell_m: float, fine: bool) -> tuple[list[_Window], list[_Cut]]:
    """The windows of the rooms, and the cuts between them. through: floor and what stands on it."""
    waiting, windows, cuts = [(slice(0, len(floor)), slice(0, len(floor[0])))], list[_Window](), list[_Cut]()
    while waiting:
        window = waiting.pop()
        masks = [mask[window] for mask in (floor, through, wall)]
        if not _without_specks(masks[0], cell_m).any():
            continue
        lines = [_best_line(some, cell_m, fine) for some in (masks, [mask.T for mask in masks])]
        axis = int(lines[1][0] > lines[0][0])
        if lines[axis][0] < 0.0:
            windows.append(window)
            continue
        side = window[axis]
        at = side.start + lines[axis][1]
        cuts.append((axis, at, window))
        for part in (slice(side.start, at), slice(at, side.stop)):
            waiting.append((window[0], part) if axis else (part, window[1]))
    return windows, cuts


def _best_line(masks: list[Mask], cell_m: float, fine: bool) -> tuple[float, int]:
    """The row along which to cut, with its metres of wall less those of floor across it; negative where none is good:
    each side needs the floor of a room. masks: floor, through and wall as in `_cut_up`."""
    floor, lines = masks[0], _lines(masks[1], masks[2], cell_m)
    count = len(floor)
    jambs = np.bincount(lines.line, lines.jambs, count)
    wall_m = lines.wall.sum(axis=1) * cell_m
    floor_m = np.bincount(lines.line, (lines.last - lines.first) * cell_m, count)
    below = np.append(0.0, np.cumsum(floor.sum(axis=1)))[:-1] * cell_m**2
    smaller = np.minimum(below, floor.sum() * cell_m**2 - below)
    alone = np.bincount(lines.line, minlength=count) == 1  # all floor goes through it
    between = alone & (jambs == 1) & (floor_m <= DOOR_M[1])
    neck = fine & alone & (floor_m <= np.mean(DOOR_M)) & (smaller >= LEAST_M2)
    parts = (wall_m + JAMB * between >= SHORTEST_M) | (floor_m == 0.0)
    good = parts & (smaller >= np.where(between | fine, SPECK_M2, LEAST_M2))
    score = np.where(good, wall_m - PASSAGE * floor_m + JAMB * jambs, -1.0)
    score = np.where(neck, np.maximum(score, 0.0), score)
    best = int(score.argmax())
    near = np.flatnonzero(score >= score[best] - 2.0 * cell_m)
    return float(score[best]), int(np.median(near[np.abs(near - best) <= 2 * ASIDE_CELLS]))  # the middle of the wall


def _lines(through: Mask, wall: Mask, cell_m: float) -> _Lines:
    """What each row meets."""
    free = minimum_filter1d(through.view(np.int8), 2 * ASIDE_CELLS + 1, axis=0)
    solid = maximum_filter1d(wall.view(np.int8), 2 * ASIDE_CELLS - 1, axis=0)
    edges = np.diff(np.pad(free, ((0, 0), (1, 1))), axis=1)
    (line, first), (_, last) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    beside = maximum_filter1d(solid, 4 * ASIDE_CELLS + 1, axis=1) > 0
    jambs = ((last - first) * cell_m >= DOOR_M[0]) & beside[line, first] & beside[line, last - 1]
    return _Lines(line, first, last, cast(Mask, jambs), solid > 0)


def _box(window: _Window, seen: Mask, discs: list[tuple[Array, float]], shape: tuple[int, ...], cell_m: float) -> Array:
    """Corners (4, 2) of a room, metres from the lattice's corner: around its cells and the objects near them, up to the
    cuts that are near."""
    ends = np.array([(part.start, part.stop) for part in window[::-1]]).T
    cells, (first, last) = np.argwhere(seen)[:, ::-1] + ends[0], ends * cell_m
    low, high = cells.min(axis=0) * cell_m, (cells.max(axis=0) + 1) * cell_m
    for place, radius_m in discs:
        away = np.maximum(low - place, place - high).max()
        if away <= 2.0 * BEYOND_M and (place >= first).all() and (place < last).all():
            low, high = np.minimum(low, place - radius_m), np.maximum(high, place + radius_m)
    low = np.where((first > 0.0) & (low - first <= BEYOND_M), first, np.maximum(low, first))
    end = np.array(shape[::-1]) * cell_m
    high = np.where((last < end) & (last - high <= BEYOND_M), last, np.minimum(high, last))
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def _doors(
    axis: int, at: int, window: _Window, floor: Mask, wall: Mask, owner: NDArray[np.intp], cell_m: float
) -> list[tuple[Array, tuple[str, str]]]:
    """The doors in a cut: their ends (2, 2), metres from the lattice's corner, and the numbers of their rooms."""
    if axis:
        floor, wall, owner = floor.T, wall.T, owner.T
    reach, along = 4 * ASIDE_CELLS, window[1 - axis]
    strip = slice(max(at - reach, 0), min(at + reach, len(floor))), along
    lines, middle, found = _lines(floor[strip], wall[strip], cell_m), at - strip[0].start, []
    for line, first, last in zip(lines.line, lines.first, lines.last, strict=True):
        if line == middle and DOOR_M[0] <= (last - first) * cell_m <= DOOR_M[1]:
            sides = [part[:, first:last] for part in np.split(owner[strip], [middle])]
            rooms = [int(np.bincount(side[side > 0]).argmax()) if side.any() else 0 for side in sides]
            ends = np.array([[along.start + first, at], [along.start + last, at]]) * cell_m
            if 0 not in rooms and rooms[0] != rooms[1]:
                found.append((ends[:, ::-1] if axis else ends, (str(rooms[0]), str(rooms[1]))))
    return found
