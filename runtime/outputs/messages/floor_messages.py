"""The floor as ROS 2 messages: the grid for planners, and where one picture's floor ends as a laser scan."""

import math

import numpy as np

from edgemap.geometry.grid.floor_scan import FloorScan
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.runtime.frames.messages.definitions import Message
from edgemap.runtime.frames.messages.frame_ids import IDS, FrameIds
from edgemap.runtime.outputs.messages.build import header, occupancy_grid_message

BEAM_RAD = math.radians(0.5)
NEAREST_M = 0.05


def grid_message(stamp_ns: int, grid: OccupancyGrid, ids: FrameIds = IDS) -> Message:
    """`nav_msgs/OccupancyGrid` in the map frame: observed floor free, obstacles occupied, the rest unknown."""
    return occupancy_grid_message(stamp_ns, grid.cells, (grid.x_m, grid.y_m), grid.cell_m, ids)


def scan_message(stamp_ns: int, scan: FloorScan, ids: FrameIds = IDS) -> Message:
    """`sensor_msgs/LaserScan` in the base frame: the nearest contact of each beam of half a degree, NaN where the
    picture has none (REP-117: no measurement, so no cell is cleared). Intensities: the contacts' weights.
    """
    ranges_m = np.hypot(*scan.contacts_base_m.T)
    beams = np.rint(np.arctan2(scan.contacts_base_m[:, 1], scan.contacts_base_m[:, 0]) / BEAM_RAD).astype(np.intp)
    first, last = (int(beams.min()), int(beams.max())) if len(beams) else (0, 0)
    nearest = np.full(last - first + 1, np.nan)
    weights = np.zeros(last - first + 1)
    for at in np.argsort(-ranges_m, kind="stable"):  # the nearest of a beam last
        nearest[beams[at] - first], weights[beams[at] - first] = ranges_m[at], scan.weights[at]
    return {
        "header": header(stamp_ns, ids.base),
        "angle_min": first * BEAM_RAD,
        "angle_max": last * BEAM_RAD,
        "angle_increment": BEAM_RAD,
        "range_min": NEAREST_M,
        "range_max": scan.rule.reach_m + 1.0,  # from the base, the lens may be ahead of it
        "ranges": nearest.tolist(),
        "intensities": weights.tolist(),
    }
