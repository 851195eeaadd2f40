"""The numbers of the occupancy grid."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GridRule:
    """Inverse sensor model of the grid. Log-odds are natural logarithms; m is metres in the map.

    cell_m: side of a cell. reach_m: greatest range of evidence from a picture or its depth; beyond it a row of the mask
    covers too much floor. row_m: metres of floor per row of the mask up to which evidence has full weight; beyond them
    the weight is inversely proportional. floor: probability from which a cell of the mask is floor. run: least number
    of rows of floor below a contact; fewer are reflections and gaps between legs. free, occupied: log-odds of one
    picture near by. highest: bound of a cell's log-odds, for and against, so that an occupied cell becomes free after
    (highest + 1.1) / free pictures. robot_m: radius round the base that the robot itself keeps free. scan_m, scan_s:
    path or time after which the next picture is fused, as errors repeat at one place. patch_m: path after which a new
    patch begins; patches move with the trajectory. A radian of rotation counts as a metre of path. obstacle_m: height
    above the floor from which a depth measurement is an obstacle; obstacle_per_m: added to it per metre of distance
    (1.1 degrees of attitude). robot_height_m: up to which it is, or up to the lens where that is higher.
    """

    cell_m: float = 0.05
    reach_m: float = 4.0
    row_m: float = 0.06
    floor: float = 0.8
    run: int = 3
    free: float = 0.3
    occupied: float = 1.05
    highest: float = 2.5
    robot_m: float = 0.18
    scan_m: float = 0.10
    scan_s: float = 0.4
    patch_m: float = 0.75
    obstacle_m: float = 0.06
    obstacle_per_m: float = 0.02
    robot_height_m: float = 0.5
