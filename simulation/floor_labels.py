"""Floor, wall and the rest of a rendered picture, exactly: by what is drawn at each pixel and how high it lies."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.inputs.drives.floor_labels import FLOOR, OTHER, WALL
from edgemap.simulation.render.renderer import RenderedFrame
from edgemap.simulation.render.scene import ROOM_ID
from edgemap.simulation.render.view import View

RUG_M = 0.025  # thickest that is floor
BELOW_CEILING_M = 0.05


def floor_labels(frame: RenderedFrame, view: View, lens: Intrinsics, ceiling_m: float) -> NDArray[np.uint8]:
    """Labels (H, W): 1 floor and rugs, 2 walls with their doors and frames, 0 furniture, people and ceiling."""
    rows, columns = frame.ids.shape
    v, u = np.mgrid[0:rows, 0:columns]
    rays = lens.rays(np.column_stack([u.ravel(), v.ravel()]))
    up = (rays @ view.rotation_home_optical.T)[:, 2].reshape(rows, columns)
    height_m = view.position_home_m[2] + up * frame.depth_m
    labels = np.where(height_m < RUG_M, FLOOR, np.where(height_m < ceiling_m - BELOW_CEILING_M, WALL, OTHER))
    return np.where(frame.ids == ROOM_ID, labels, OTHER).astype(np.uint8)
