"""Goal poses: where a robot reaches an object, facing it and standing on free floor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import distance_transform_edt

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import BESIDE_M, FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.grid.rooms import Room, inside
from edgemap.geometry.map_object import MapObject, radius_m
from edgemap.geometry.se2 import SE2, wrap_angle

DIRECTIONS = 48  # about the object, in which a pose is tried
STEP_M, REACH_M = 0.1, 1.0  # how much farther than the wished standoff, where that is taken
UNKNOWN_M = 10.0  # cost of floor that nobody has seen
WALK_SHARE = 0.1  # of the distance from the robot: of two good poses the nearer one


@dataclass(frozen=True, slots=True)
class ApproachRule:
    """Where a robot stops before an object."""

    standoff_m: float = 0.4  # from the object's edge to the robot's
    robot_radius_m: float = 0.25  # of the circle that holds the robot


@dataclass(frozen=True, slots=True)
class Approach:
    """pose: of the base in the map frame, facing the object. standoff_m: resulting distance. floor: `free` where the
    robot's whole circle is observed free, `unknown` where the grid does not cover it.
    """

    pose: SE2
    standoff_m: float
    floor: str


def approach(
    item: MapObject,
    objects: Sequence[MapObject],
    grid: OccupancyGrid | None = None,
    robot_m: Sequence[float] | None = None,
    rule: ApproachRule | None = None,
) -> Approach:
    """The cheapest pose about an object: near the requested standoff, in front of it where it has a yaw, on free floor,
    clear of other objects, near the robot (robot_m: x, y).

    Where there is a grid, the robot's circle may not overlap an occupied cell, and free floor is preferred to unknown.
    Raises MapError with the numbers where every place is taken.
    """
    rule = rule or ApproachRule()
    others, radius = [other for other in objects if other.id != item.id], rule.robot_radius_m
    yaw_rad = item.footprint.yaw_rad
    around = np.arange(DIRECTIONS) * 2.0 * math.pi / DIRECTIONS
    standoffs_m = np.arange(rule.standoff_m, rule.standoff_m + REACH_M + 1e-9, STEP_M)
    best: tuple[float, Approach | None] = math.inf, None
    for standoff_m, direction in product(standoffs_m.tolist(), around.tolist()):
        away, edge_m = np.array([math.cos(direction), math.sin(direction)]), _extent_m(item, direction)
        at = item.position_m + away * (edge_m + standoff_m + radius)
        floor = _floor(at, grid, radius)
        blocked = grid is not None and _wall_between(item.position_m, away, edge_m, edge_m + standoff_m, grid)
        crowded = any(np.linalg.norm(at - other.position_m) < radius_m(other) + radius for other in others)
        if floor == "taken" or blocked or crowded:
            continue
        cost = standoff_m + (UNKNOWN_M if floor == "unknown" else 0.0)
        if yaw_rad is not None:  # a pose a quarter turn away from the object's front costs a metre
            cost += abs(wrap_angle(direction - yaw_rad)) / (math.pi / 2.0)
        if robot_m is not None:
            cost += WALK_SHARE * float(np.linalg.norm(at - np.asarray(robot_m)))
        if cost < best[0]:
            best = cost, Approach(SE2(at[0], at[1], direction + math.pi), standoff_m, floor)
    if best[1] is None:
        raise MapError(
            f"no place to approach {item.id!r} from: all {len(standoffs_m) * DIRECTIONS} poses within "
            f"{rule.standoff_m + REACH_M:.1f} m of it are taken (robot radius {radius:g} m)"
        )
    return best[1]


def room_pose(room: Room, grid: OccupancyGrid, rule: ApproachRule) -> SE2:
    """The pose inside a room that is farthest from everything that is not free floor. Raises MapError where no place
    in it is wide enough for the robot."""
    free = np.pad(grid.cells == FREE, 1)
    clear_m = np.asarray(distance_transform_edt(free))[1:-1, 1:-1] * grid.cell_m
    centres_m = grid.centres_m(np.ones(grid.cells.shape, np.bool_))
    clear_m = np.where(inside(room.corners_m, centres_m), clear_m.ravel(), 0.0)
    best = int(clear_m.argmax())
    if clear_m[best] < rule.robot_radius_m:
        raise MapError(f"no free place in {room.id} for a robot of {rule.robot_radius_m:g} m radius")
    x_m, y_m = centres_m[best].tolist()
    return SE2(x_m, y_m, 0.0)


def _extent_m(item: MapObject, direction_rad: float) -> float:
    """Distance from an object's centre to its edge in one direction: of its rectangle where it has a yaw, else of the
    circle of equal area."""
    shape = item.footprint
    if shape.yaw_rad is None:
        return radius_m(item)
    off_rad = direction_rad - shape.yaw_rad
    along, across = abs(math.cos(off_rad)), abs(math.sin(off_rad))
    return min(shape.depth_m / 2.0 / max(along, 1e-9), shape.width_m / 2.0 / max(across, 1e-9))


def _wall_between(centre: Array, away: Array, from_m: float, to_m: float, grid: OccupancyGrid) -> bool:
    """Whether something occupied lies between an object's edge and the robot's. Cells up to `BESIDE_M` beyond the
    edge are the object's, as the grid may have moved it."""
    along = np.arange(from_m + BESIDE_M, to_m, grid.cell_m)
    return bool((grid.at(centre + along[:, None] * away) == OCCUPIED).any())


def _floor(at: Array, grid: OccupancyGrid | None, robot_radius_m: float) -> str:
    """State of the robot's circle in the grid: free, unknown or taken."""
    if grid is None:
        return "unknown"
    # Every cell that the circle touches: the point of it nearest to the centre lies in the circle.
    reach = math.ceil(robot_radius_m / grid.cell_m) + 1
    steps = np.arange(-reach, reach + 1)
    corner = np.array([grid.x_m, grid.y_m])
    first = corner + np.floor((at - corner) / grid.cell_m) * grid.cell_m
    low = first + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * grid.cell_m
    touched = np.linalg.norm(np.clip(at, low, low + grid.cell_m) - at, axis=1) <= robot_radius_m
    cells = grid.at(low[touched] + grid.cell_m / 2.0)
    if (cells == OCCUPIED).any():
        return "taken"
    return "free" if (cells == FREE).all() else "unknown"
