"""Draws the plan of a home from a seed: rooms side by side, walls, doorways and windows."""

import tomllib
from dataclasses import replace
from importlib import resources
from itertools import combinations, pairwise

import numpy as np

from edgemap.simulation.apartment.plan import WALL_M, ApartmentPlan, Doorway, Rectangle, RoomArea, Window, turned

_HOMES = tomllib.loads(resources.files("edgemap.simulation.apartment").joinpath("homes.toml").read_text())
_LEAF_M, _DOOR_HEIGHT_M = 0.04, 2.05
_NARROWEST_DOORWAY_M, _WIDEST_DOORWAY_M, _WIDEST_OPENING_M = 0.88, 1.05, 1.7
_CORNER_M = 0.12


def draw_plan(rng: np.random.Generator) -> ApartmentPlan:
    """A plan of one (rarely) to four rooms, every room connected to the main one by doorways."""
    count = int(rng.choice([1, 2, 3, 4], p=[0.06, 0.30, 0.36, 0.28]))
    homes = _HOMES[str(count)]
    kinds = tuple(homes[int(rng.integers(len(homes)))].split())
    width, depth, cells = _split(count, kinds, rng)
    turn, flip_x, flip_y = (bool(rng.random() < 0.5) for _ in range(3))
    if turn:
        width, depth, cells = depth, width, [turned(cell, True) for cell in cells]
    if flip_x:
        cells = [(width - x1, y0, width - x0, y1) for x0, y0, x1, y1 in cells]
    if flip_y:
        cells = [(x0, depth - y1, x1, depth - y0) for x0, y0, x1, y1 in cells]
    rooms = tuple(RoomArea(kind, *cell) for kind, cell in zip(kinds, cells, strict=True))
    height = float(rng.uniform(2.4, 2.8))
    plan = ApartmentPlan(width, depth, height, rooms, (), _doorways(rooms, height, rng), ())
    leaves = tuple(_leaf(rooms, door, rng) for door in plan.doorways if door.leaf)
    plan = replace(plan, walls=(*_walls(plan), *leaves), leaves=leaves)
    return replace(plan, windows=_windows(plan, rng))


def _split(count: int, kinds: tuple[str, ...], rng: np.random.Generator) -> tuple[float, float, list[Rectangle]]:
    """Outer width and depth, and one inner rectangle per room: a left column, and a right one from two rooms on."""
    t = WALL_M
    left, right = float(rng.uniform(4.3, 5.4)), float(rng.uniform(3.1, 3.9))
    if count == 1:
        width, depth = float(rng.uniform(5.0, 6.6)), float(rng.uniform(4.2, 5.2))
        return width + 2 * t, depth + 2 * t, [(t, t, t + width, t + depth)]
    if count == 2:
        depth = float(rng.uniform(4.0, 5.0))
        return left + right + 3 * t, depth + 2 * t, [(t, t, t + left, t + depth), _column(t, left, right, t, t + depth)]
    small = {"bathroom": 2.3, "hall": 2.4, "kitchen": 2.8, "study": 2.9}
    share = float(rng.uniform(0.0, 0.5)) + small.get(kinds[-1], 3.1)
    other = float(rng.uniform(2.9, 3.6))
    depth = share + other + t
    bottom, top = t + other, t + other + t
    uppers = [_column(t, left, right, t, bottom), _column(t, left, right, top, t + depth)]
    if count == 3:
        return left + right + 3 * t, depth + 2 * t, [(t, t, t + left, t + depth), *uppers]
    # The left column is split too, at its own height: the main room keeps the larger part.
    second = float(rng.uniform(2.9, 3.2))
    main = max(depth - second - t, 3.6)
    second = depth - main - t
    if second < 2.6:
        depth, second = main + t + 2.9, 2.9
        uppers[1] = (*uppers[1][:3], t + depth)
    cells = [(t, t, t + left, t + main), (t, t + main + t, t + left, t + depth), *uppers]
    return left + right + 3 * t, depth + 2 * t, cells


def _column(t: float, left: float, right: float, y0: float, y1: float) -> Rectangle:
    return 2 * t + left, y0, 2 * t + left + right, y1


def _shared(a: RoomArea, b: RoomArea) -> tuple[bool, float, float, float] | None:
    """The wall between two neighbours: whether it is crossed along x, its low face, and the part that both share."""
    for across_x in (True, False):
        ends = np.array([turned(room.rectangle, not across_x) for room in (a, b)])
        (beyond, start), (low, end) = ends[:, :2].max(axis=0), ends[:, 2:].min(axis=0)
        if abs(beyond - low - WALL_M) < 1e-6 and end - start > 1.25:
            return across_x, float(low), float(start), float(end)
    return None


def _doorways(rooms: tuple[RoomArea, ...], height_m: float, rng: np.random.Generator) -> tuple[Doorway, ...]:
    """A tree of doorways from the main room, and now and then one more that closes a loop."""
    doorways: list[Doorway] = []
    reached = {0}
    pairs = [pair for pair in combinations(range(len(rooms)), 2) if _shared(rooms[pair[0]], rooms[pair[1]])]
    while len(reached) < len(rooms):
        a, b = next(pair for pair in pairs if len(reached & set(pair)) == 1)
        doorways.append(_doorway(rooms, a, b, height_m, rng))
        pairs.remove((a, b))
        reached |= {a, b}
    for a, b in pairs:
        if "bathroom" not in (rooms[a].kind, rooms[b].kind) and rng.random() < 0.3:
            doorways.append(_doorway(rooms, a, b, height_m, rng))
    return tuple(doorways)


def _doorway(rooms: tuple[RoomArea, ...], a: int, b: int, height_m: float, rng: np.random.Generator) -> Doorway:
    shared = _shared(rooms[a], rooms[b])
    assert shared is not None
    across_x, face, low, high = shared
    open_kinds = {"living", "dining", "kitchen", "hall"}
    is_open = {rooms[a].kind, rooms[b].kind} <= open_kinds and rng.random() < 0.5
    leaf = not is_open and rng.random() < 0.6
    widest = min(_WIDEST_OPENING_M if is_open else _WIDEST_DOORWAY_M, high - low - 2 * _CORNER_M)
    width = float(rng.uniform(_NARROWEST_DOORWAY_M, widest))
    # Doors sit near the end of a wall more often than in its middle, which leaves room for furniture.
    along = float(rng.choice([rng.uniform(0.0, 0.15), rng.uniform(0.85, 1.0), rng.uniform(0.0, 1.0)]))
    start = low + _CORNER_M + along * (high - low - width - 2 * _CORNER_M)
    top = height_m if is_open and rng.random() < 0.4 else _DOOR_HEIGHT_M
    return Doorway(*turned((face, start, face + WALL_M, start + width), not across_x), (a, b), leaf, top)


def _leaf(rooms: tuple[RoomArea, ...], door: Doorway, rng: np.random.Generator) -> Rectangle:
    """Where an open door leaf stands: at one end of the gap, square to the wall, in either room."""
    room = rooms[door.rooms[int(rng.integers(2))]]
    at_low = bool(rng.random() < 0.5)
    near, start, far, end = turned(door.rectangle, not door.across_x)
    low, high = (start - _LEAF_M, start) if at_low else (end, end + _LEAF_M)
    beyond = turned(room.rectangle, not door.across_x)[0] >= far
    near, far = (far, far + (end - start)) if beyond else (near - (end - start), near)
    return turned((near, low, far, high), not door.across_x)


def _walls(plan: ApartmentPlan) -> tuple[Rectangle, ...]:
    """What is neither room nor doorway, cut into rectangles along the lines of all of them."""
    holes = [*(room.rectangle for room in plan.rooms), *(door.rectangle for door in plan.doorways)]
    xs = sorted({0.0, plan.width_m, *(x for hole in holes for x in (hole[0], hole[2]))})
    ys = sorted({0.0, plan.depth_m, *(y for hole in holes for y in (hole[1], hole[3]))})
    pieces: list[Rectangle] = []
    for x0, x1 in pairwise(xs):
        column: list[Rectangle] = []
        for y0, y1 in pairwise(ys):
            x, y = (x0 + x1) / 2.0, (y0 + y1) / 2.0
            if x1 - x0 < 1e-6 or y1 - y0 < 1e-6 or any(h[0] < x < h[2] and h[1] < y < h[3] for h in holes):
                continue
            if column and column[-1][3] == y0:
                column[-1] = (x0, column[-1][1], x1, y1)
            else:
                column.append((x0, y0, x1, y1))
        for piece in column:
            before = next((p for p in pieces if p[2] == piece[0] and (p[1], p[3]) == (piece[1], piece[3])), None)
            if before is not None:
                pieces.remove(before)
                piece = (before[0], piece[1], piece[2], piece[3])
            pieces.append(piece)
    return tuple(pieces)


def _windows(plan: ApartmentPlan, rng: np.random.Generator) -> tuple[Window, ...]:
    """One or two windows per room on its outer walls; small high ones in bathrooms, now and then down to the floor."""
    windows = []
    for index, room in enumerate(plan.rooms):
        walls = {"left": room.x0, "right": plan.width_m - room.x1, "near": room.y0, "far": plan.depth_m - room.y1}
        sides = [side for side, thick in walls.items() if thick < WALL_M + 1e-6]
        wanted = 1 if room.kind in {"bathroom", "hall", "kitchen"} else int(rng.integers(1, 3))
        for side in rng.permutation(sides)[:wanted]:
            low, high, _ = room.wall(str(side))
            if room.kind == "bathroom":
                width, sill, top = rng.uniform(0.5, 0.8), rng.uniform(1.2, 1.4), rng.uniform(1.9, 2.1)
            elif room.kind in {"living", "bedroom"} and rng.random() < 0.25:
                width, sill, top = rng.uniform(1.0, 1.8), 0.06, 2.15
            else:
                width, sill, top = rng.uniform(0.9, 1.7), rng.uniform(0.8, 1.05), rng.uniform(1.95, 2.2)
            width = min(float(width), high - low - 0.6)
            start = float(rng.uniform(low + 0.25, high - 0.25 - width))
            windows.append(Window(index, str(side), start, start + width, float(sill), float(top)))
    return tuple(windows)
