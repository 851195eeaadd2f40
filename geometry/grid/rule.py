"""The numbers of the occupancy grid."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GridRule:
    """Inverse sensor model of the grid. Log-odds are natural logarithms; m is metres in the map. A radian of rotation
    counts as a metre of path.
    """

    cell_m: float = 0.05  # side of a cell
    reach_m: float = 4.0  # greatest range of picture and depth: farther off, a row of the mask covers too much floor
    # Floor per row of the mask up to which evidence has full weight; beyond, the weight is inversely proportional.
    row_m: float = 0.06
    floor: float = 0.8  # probability from which a cell of the mask is floor
    run: int = 3  # least rows of floor below a contact; fewer are reflections and gaps between legs
    free: float = 0.3  # log-odds of one picture near by
    occupied: float = 1.05  # log-odds of one picture near by
    # Bound of a cell's log-odds, for and against: an occupied cell becomes free after (highest + 1.1) / free pictures.
    highest: float = 2.5
    robot_m: float = 0.18  # radius round the base that the robot itself keeps free
    scan_m: float = 0.10  # path after which the next picture is fused, as errors repeat at one place
    scan_s: float = 0.4  # time after which the next picture is fused
    patch_m: float = 0.75  # path after which a new patch begins; patches move with the trajectory
    obstacle_m: float = 0.06  # height above the floor from which a depth measurement is an obstacle
    obstacle_per_m: float = 0.02  # added to obstacle_m per metre of distance (1.1 degrees of attitude)
    robot_height_m: float = 0.5  # height up to which it is one, or up to the lens where that is higher
