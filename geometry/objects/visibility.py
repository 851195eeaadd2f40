"""Which objects of the map should be visible in a picture if they are still present."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.floor_scan import EDGE
from edgemap.geometry.map_object import MapObject, radius_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2

AROUND = 8  # points of a footprint's circle that are projected


@dataclass(frozen=True, slots=True)
class ViewRule:
    """When an object is in plain view: also no farther than the greatest distance at which it was detected, since
    detectors miss small objects.
    """

    # Distance from the robot within which it was observed before: the map may lack walls, but none hides what was
    # observed from here.
    near_view_m: float = 0.75
    covered_share: float = 0.2  # of its box, at most, behind nearer boxes or nearer objects of the map


def expected_boxes(objects: Sequence[MapObject], camera: FloorCamera, pose_map_base: SE2) -> Array:
    """Projects each object's upright cylinder (footprint's circle, mean height) to a box (N, 4), x0 y0 x1 y1 px as
    detectors count; NaN where a part of it is behind the camera.
    """
    centres = pose_map_base.inverse().apply(np.array([item.position_m for item in objects]))
    radii = np.array([radius_m(item) for item in objects])
    heights = np.array([item.height_m for item in objects])
    turns = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    ring = centres[:, None] + radii[:, None, None] * np.column_stack([np.cos(turns), np.sin(turns)])[None]
    cylinders = np.dstack([np.tile(ring, (1, 2, 1)), heights[:, None] * np.repeat([0.0, 1.0], AROUND)])
    pixels = camera.project(cylinders.reshape(-1, 3)).reshape(len(objects), -1, 2) + 0.5
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=-1)


def in_plain_view(
    objects: Sequence[MapObject],
    boxes: Array,
    camera: FloorCamera,
    pose_map_base: SE2,
    detections: Detections,
    rule: ViewRule,
) -> NDArray[np.bool_]:
    """Which objects should be detected, by their expected boxes: fully in the picture, near, observed before from near
    here, and not occluded; (N,).
    """
    size = camera.intrinsics.width, camera.intrinsics.height
    inside = (boxes[:, :2] >= 0.0).all(axis=1) & (boxes[:, 2:] <= size).all(axis=1)
    here = np.array([pose_map_base.x_m, pose_map_base.y_m])
    clear = np.zeros(len(objects), dtype=bool)
    reach = np.linalg.norm(np.array([item.position_m for item in objects]).reshape(-1, 2) - here, axis=1)
    for row in np.flatnonzero(inside).tolist():
        views = np.array(objects[row].seen_from_m).reshape(-1, 2)
        if len(views) == 0 or _off_lines_m(here, views, objects[row].position_m) > rule.near_view_m:
            continue
        seen_m = np.linalg.norm(views - objects[row].position_m, axis=1).max()
        if reach[row] > seen_m:
            continue
        nearer = np.concatenate(
            [detections.boxes[detections.boxes[:, 3] > boxes[row, 3]], boxes[(reach < reach[row]) & (boxes[:, 2] > 0)]]
        )
        # A box with NaN hides nothing.
        clear[row] = np.nan_to_num(shares_inside(boxes[row], nearer)).max(initial=0.0) <= rule.covered_share
    return clear


def floor_in_place(
    objects: Sequence[MapObject], camera: FloorCamera, pose_map_base: SE2, mask: FloorMask
) -> NDArray[np.bool_]:
    """Which objects have visible floor in their place, (N,): at the position and all round its ellipse of one standard
    deviation, where that is large enough for the mask. No wall stands before it then, wherever the robot is.
    """
    turns = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    circle = np.column_stack([np.append(np.cos(turns), 0.0), np.append(np.sin(turns), 0.0)])
    ellipses = circle @ np.linalg.cholesky([item.covariance_m2 for item in objects]).transpose(0, 2, 1)
    places = pose_map_base.inverse().apply(
        (ellipses + np.array([item.position_m for item in objects])[:, None]).reshape(-1, 2)
    )
    pixels = camera.project(np.column_stack([places, np.zeros(len(places))]))
    shows = (mask.at(pixels) > EDGE).reshape(len(objects), -1).all(axis=1)
    return shows & (np.ptp(pixels[:, 1].reshape(len(objects), -1), axis=1) >= mask.height / len(mask.floor))


def _off_lines_m(here: Array, views: Array, position_m: Array) -> float:
    """Distance from a place (2,) to the nearest of the lines from views (N, 2) to an object's position (2,)."""
    lines = position_m - views
    along = np.einsum("ni,ni->n", here - views, lines) / np.maximum((lines**2).sum(axis=1), 1e-9)
    return float(np.linalg.norm(views + np.clip(along, 0.0, 1.0)[:, None] * lines - here, axis=1).min())


def shares_inside(box: Array, others: Array) -> Array:
    """Share of a box that lies in each of the others, (N,)."""
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    return np.prod(np.maximum(sides, 0.0), axis=1) / max(float(np.prod(box[2:] - box[:2])), 1e-9)


def iou(box: Array, others: Array) -> Array:
    """Intersection over union of a box with each of the others, (N,)."""
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    overlap = np.prod(np.maximum(sides, 0.0), axis=1)
    areas = np.prod(others[:, 2:] - others[:, :2], axis=1) + np.prod(box[2:] - box[:2])
    return overlap / np.maximum(areas - overlap, 1e-9)
