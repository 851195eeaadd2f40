"""A route graph for Nav2's route server: rooms and doors as nodes, clear straight ways over free floor as edges."""

import json
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import FREE, OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.objects.approach import ApproachRule, room_pose
from edgemap.geometry.objects.rooms import title_of

FRAME_ID = "map"


def route_text(rooms: Sequence[Room], doors: Sequence[Door], grid: OccupancyGrid | None, robot_m: float) -> str:
    """GeoJSON as nav2_route's GeoJsonGraphFileLoader reads it: Points with `id`, LineStrings with `id`, `startid` and
    `endid`, one for each direction. Node metadata: `class` (room, door or way), the map's `id`, `name` of a room,
    `open` of a door; edges to a door have its `door` and `open`. Rooms without a door are left out. robot_m: radius of
    the robot; edges keep it clear of everything that is not free, or of as much as a door allows.

    Source: nav2_route/src/plugins/graph_file_loaders/geojson_graph_file_loader.cpp. Raises MapError where no door joins
    two rooms, as the server takes no graph without edges.
    """
    if grid is None or not doors:
        raise MapError("no door between two rooms on the map: a route graph needs one")
    ways = _Ways(grid, robot_m)
    nodes: list[tuple[Array, dict]] = []
    edges: list[tuple[int, int, dict]] = []
    numbers: dict[str, int] = {}
    for room in [room for room in rooms if any(room.id in door.rooms for door in doors)]:
        pose = room_pose(room, grid, ApproachRule(robot_radius_m=grid.cell_m))
        numbers[room.id] = len(nodes)
        nodes.append((np.array([pose.x_m, pose.y_m]), {"class": "room", "id": room.id, "name": title_of(room)}))
    for door in doors:
        state = {"door": door.id, "open": round(door.open, 3)}
        middle = len(nodes)
        nodes.append((door.centre_m, {"class": "door", "id": door.id, "open": state["open"]}))
        for name in door.rooms:
            way = ways.between(nodes[numbers[name]][0], door.centre_m)
            between = [len(nodes) + k for k in range(len(way) - 2)]
            nodes += [(point, {"class": "way"}) for point in way[1:-1]]
            chain = [numbers[name], *between, middle] if len(way) else []
            edges += [(*pair, state) for a, b in pairwise(chain) for pair in ((a, b), (b, a))]
    if not edges:
        raise MapError("no free floor from a room to its door on the map: a route graph needs one")
    points = [[round(float(x), 3) for x in point] for point, _ in nodes]
    features = [
        _feature("Point", points[number], {"id": number, "frame": FRAME_ID, "metadata": about})
        for number, (_, about) in enumerate(nodes)
    ]
    features += [
        _feature("LineString", [points[a], points[b]], {"id": number, "startid": a, "endid": b, "metadata": about})
        for number, (a, b, about) in enumerate(edges, len(nodes))
    ]
    return json.dumps({"type": "FeatureCollection", "name": "graph", "features": features}, indent=1) + "\n"


def _feature(kind: str, coordinates: list, properties: dict) -> dict:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def cell_links(free: NDArray[np.bool_], cost: Array, cell_m: float) -> csr_array:
    """Costs between neighbouring free cells, to eight sides, each pair once. cost: of a metre in each cell."""
    number, (rows, columns) = np.arange(free.size).reshape(free.shape), free.shape
    starts, ends, costs = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = slice(0, rows - down), slice(max(-right, 0), columns - max(right, 0))
        b = slice(down, rows), slice(max(right, 0), columns + min(right, 0))
        both = free[a] & free[b]
        starts.append(number[a][both])
        ends.append(number[b][both])
        costs.append(np.hypot(down, right) * cell_m * (cost[a][both] + cost[b][both]) / 2.0)
    pairs = np.concatenate(starts), np.concatenate(ends)
    return csr_array(coo_array((np.concatenate(costs), pairs), shape=(free.size, free.size)))


class _Ways:
    """Ways over the free cells of a grid, the clearer the better."""

    def __init__(self, grid: OccupancyGrid, robot_m: float) -> None:
        self._grid, self._least_m, free = grid, robot_m, grid.cells == FREE
        self._clear_m = clear_m = np.asarray(distance_transform_edt(np.pad(free, 1)))[1:-1, 1:-1] * grid.cell_m
        cost = 1.0 + np.square(np.clip(2.0 * robot_m - clear_m, 0.0, None) / grid.cell_m)
        self._graph = cell_links(free, cost, grid.cell_m)

    def between(self, start_m: Array, end_m: Array) -> Array:
        """Corners (N, 2) of a way from one point to another, N at least 2; none where there is no way."""
        first, last = (self._nearest(point) for point in (start_m, end_m))
        _, before = dijkstra(self._graph, directed=False, indices=first, return_predecessors=True)
        cells = [last]
        while cells[-1] != first and before[cells[-1]] >= 0:
            cells.append(int(before[cells[-1]]))
        if cells[-1] != first:
            return np.zeros((0, 2))
        points = np.array([start_m, *map(self._centre, cells[-2:0:-1]), end_m])
        corners, at = [points[0]], 0
        while at < len(points) - 1:
            far = next(k for k in range(len(points) - 1, at, -1) if k == at + 1 or self._is_clear(points[at : k + 1]))
            corners.append(points[far])
            at = far
        return np.array(corners)

    def _is_clear(self, points: Array) -> bool:
        """Whether the straight line between the ends of a way is as clear as the robot needs, or as the way itself."""
        steps = np.linspace(0.0, 1.0, 2 + int(np.hypot(*(points[-1] - points[0])) / self._grid.cell_m))[:, None]
        straight, along = (self._clear_at(some) for some in (points[0] + steps * (points[-1] - points[0]), points))
        return bool(straight.min() >= min(self._least_m, along.min()))

    def _clear_at(self, points: Array) -> Array:
        cells = np.floor((points - [self._grid.x_m, self._grid.y_m]) / self._grid.cell_m).astype(int)
        rows, columns = np.clip(cells[:, ::-1], 0, np.array(self._clear_m.shape) - 1).T
        return self._clear_m[rows, columns]

    def _nearest(self, point: Array) -> int:
        """The free cell nearest to a point."""
        free = np.flatnonzero(self._clear_m.ravel() > 0.0)
        return int(free[np.square(self._centre(free) - point).sum(axis=-1).argmin()])

    def _centre(self, cell: ArrayLike) -> Array:
        rows, columns = np.divmod(np.asarray(cell), self._clear_m.shape[1])
        return np.stack([columns + 0.5, rows + 0.5], axis=-1) * self._grid.cell_m + [self._grid.x_m, self._grid.y_m]
