"""Evidence of one depth picture: free floor, and obstacles at the robot's height."""

from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.floor_scan import inside_boxes
from edgemap.geometry.grid.rule import GridRule
from edgemap.geometry.observations.sparse_depth import EVERY_PX, SparseDepth


@dataclass(frozen=True, slots=True, eq=False)
class DepthScan:
    """floor_base_m, obstacles_base_m: (N, 2) each, base frame."""

    floor_base_m: Array
    obstacles_base_m: Array

    @classmethod
    def of(cls, depth: SparseDepth, camera: FloorCamera, movers_px: Array, rule: GridRule) -> "DepthScan":
        """Classifies points by their height above the floor, whose error grows with range through the attitude. Points
        above the robot are no evidence. movers_px: boxes (M, 4) of people and animals, which make no obstacle
        within one point of the lattice.
        """
        points, pixels = depth.points(camera.intrinsics, rule.reach_m)
        base = points @ camera.mount.rotation_base_optical().T + camera.mount.position_base_m()
        unsure_m = rule.obstacle_m + rule.obstacle_per_m * np.hypot(base[:, 0], base[:, 1])
        top_m = max(camera.mount.height_m, rule.robot_height_m)
        stands = (base[:, 2] > unsure_m) & (base[:, 2] < top_m)
        at = np.flatnonzero(stands)
        at = at[~inside_boxes(pixels[at], movers_px, EVERY_PX)]
        return cls(base[np.abs(base[:, 2]) <= unsure_m, :2], base[at, :2])
