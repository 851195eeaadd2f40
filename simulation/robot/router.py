"""Paths over the free floor: the cheapest on a grid with a cost near obstacles, then smoothed."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from edgemap.runtime.outputs.map_formats.route import cell_links
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.motion import Limits
from edgemap.simulation.robot.plan_grid import PlanGrid

_SPACING_M = 0.1
_STEP_M = 0.02
# Rounding tried, widest first: the standard deviation of the kernel along the path.
_ROUNDINGS_M = (0.36, 0.26, 0.18, 0.12, 0.08)
_HAIRPIN_RAD, _HAIRPIN_M = 1.3, 0.2
# Beside furniture a metre costs this much more, falling off over the second number's distance.
_SHY, _SHY_M = 3.0, 0.2


class Router:
    """Plans paths for a robot of given limits. nodes_m: (N, 2) points that it can reach, all from one another.

    Raises SimulationError where the home has no floor to drive on.
    """

    def __init__(self, grid: PlanGrid, limits: Limits) -> None:
        self._grid, self._need_m = grid, limits.radius_m + limits.margin_m
        columns, rows = (int(side / _SPACING_M) for side in grid.size_m)
        x, y = np.meshgrid((np.arange(columns) + 0.5) * _SPACING_M, (np.arange(rows) + 0.5) * _SPACING_M)
        points = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
        clearance = grid.clearance_m(points)
        free = clearance > self._need_m
        dear = 1.0 + _SHY * np.exp(-np.maximum(clearance - self._need_m, 0.0) / _SHY_M)
        links = cell_links(free.reshape(rows, columns), dear.reshape(rows, columns), _SPACING_M)
        count, part = connected_components(links, directed=False)
        sizes = np.bincount(part[free], minlength=count)
        if sizes.max(initial=0) < 20:
            raise SimulationError("no floor to drive on in this home")
        self._keep = np.flatnonzero(free & (part == sizes.argmax()))
        self.nodes_m = points[self._keep]
        self.room_m = clearance[self._keep]
        self._links = csr_array(links[self._keep][:, self._keep])

    def nearest(self, point_m: Array) -> int:
        """Index of the node nearest to a point."""
        return int(np.argmin(((self.nodes_m - point_m) ** 2).sum(axis=1)))

    def reach(self, start: int) -> tuple[Array, NDArray[np.int32]]:
        """Cost to every node from one, and each node's predecessor on the cheapest path."""
        cost, before = dijkstra(self._links, directed=False, indices=start, return_predecessors=True)
        return cost, before

    def chain(self, before: NDArray[np.int32], goal: int) -> Array:
        """Points (N, 2) from the start of `reach` to a node."""
        chain = [goal]
        while (step := int(before[chain[-1]])) >= 0:
            chain.append(step)
        return self.nodes_m[chain[::-1]]

    def rounded(self, points_m: Array) -> Array | None:
        """A smooth path through points, sampled every 2 cm, as round as the clearance allows; None where none is free,
        or it doubles back.
        """
        apart = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
        points_m = points_m[np.concatenate([[True], apart > 1e-6])]
        travelled = np.concatenate([[0.0], np.cumsum(apart[apart > 1e-6])])
        if travelled[-1] < 0.15:
            return None
        dense = np.arange(0.0, travelled[-1], _STEP_M)
        line = np.stack([np.interp(dense, travelled, points_m[:, axis]) for axis in range(2)], axis=1)
        for sigma_m in _ROUNDINGS_M:
            smooth = smoothed(line, sigma_m / _STEP_M)
            if self._grid.clearance_m(smooth).min() > self._need_m - 0.02:
                path = _even(smooth)
                return None if _turns_back(path) else path
        return None


def smoothed(line: Array, sigma: float) -> Array:
    """A line (N, D) rounded off with both ends in place: beyond them it goes on as its mirror image through the end."""
    pad = min(len(line) - 1, int(4 * sigma))
    head, tail = 2.0 * line[0] - line[pad:0:-1], 2.0 * line[-1] - line[-2 : -pad - 2 : -1]
    return gaussian_filter1d(np.concatenate([head, line, tail]), sigma, axis=0)[pad : pad + len(line)]


def _turns_back(path: Array) -> bool:
    """Whether it bends by more than _HAIRPIN_RAD within _HAIRPIN_M: such a turn is one on the spot."""
    steps = np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    apart = max(1, round(_HAIRPIN_M / _STEP_M))
    return bool(np.abs(heading[apart:] - heading[:-apart]).max(initial=0.0) > _HAIRPIN_RAD)


def _even(line: Array) -> Array:
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, travelled[-1], max(8, int(travelled[-1] / _STEP_M)))
    return np.stack([np.interp(at, travelled, line[:, axis]) for axis in range(2)], axis=1)
